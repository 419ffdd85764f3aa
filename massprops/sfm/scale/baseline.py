"""A stereo rig: the second camera's mounting is in metres and the adjustment keeps it."""

import math

from massprops.sfm.scale._base import ScaleEstimate, ScaleInputs

MOUNTING = 1e-3
"""Relative 1-sigma of a baseline whose own is not stated."""


def estimate(inputs: ScaleInputs) -> ScaleEstimate | None:
    """Depth scales with baseline times focal length, so the focal length's error counts."""
    if inputs.rig_metres is None:
        return None
    return ScaleEstimate("baseline", inputs.rig_metres, math.hypot(MOUNTING, inputs.focal_sigma))
