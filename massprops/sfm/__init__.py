"""Structure from motion with pycolmap; attitude history and tracks of a tumbling body."""
