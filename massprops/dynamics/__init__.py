"""Rigid-body motion, relative orbits, quaternions."""
