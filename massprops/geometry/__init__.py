"""Plain geometry that every stage shares: cameras, triangles, planes."""
