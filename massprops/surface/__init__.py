"""A watertight surface from dense points and silhouettes, and which faces were measured."""
