"""A mapped model and its footage as a global shutter would have given them."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace

import pycolmap

from massprops.sfm.attempt import ModelInputs
from massprops.sfm.footage import FootageRecord
from massprops.sfm.global_images import write_global
from massprops.sfm.refine import Effort, adjust
from massprops.sfm.rolling_shutter import Keypoints, frame_times
from massprops.sfm.row_motion import Readout, Seen

LOSS_PX = 1.0
"""Scale of the loss before outliers are removed [px]: they are many, and the adjustment need only follow the shifts."""


def to_global_shutter(
    mapped: pycolmap.Reconstruction, seen: Seen, readout: Readout, given: ModelInputs
) -> FootageRecord:
    """Moves the features of a mapped model in place, takes out images whose motion is not known, and warps the others.

    Args:
        mapped: before its last adjustment.
        seen: the model by which the readout was found.

    Returns:
        the footage, its images in a folder below `given.work`.
    """
    mapping, times = given.found.mapping, frame_times(given.footage)
    placed, manager = set(seen.views.names), pycolmap.ObservationManager(mapped)
    for image_id in list(mapped.reg_image_ids()):
        image = mapped.image(image_id)
        if image.name not in placed and image.has_pose:
            manager.deregister_frame(image.frame_id)
    keypoints = Keypoints(mapped)
    for _ in range(2):  # the shifts follow the poses, which follow the shifts
        adjust(
            mapped, not mapping.fixed_intrinsics, False, LOSS_PX, given.options.threads, Effort(20), mapping.constant
        )
        keypoints.correct(mapped, times or {}, readout)
    folder = given.work / "global"
    write_global(given.footage, seen, readout, folder)
    return replace(given.footage, folder=folder)
