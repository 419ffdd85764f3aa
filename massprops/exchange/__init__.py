"""Comparison with CAD; one file per export format."""
