"""Meshes of the bodies that come with the package; closed, in metres."""
