"""Cameras, stereo, range: state to measurements, with Jacobians."""
