"""The images of earlier stages, as the stages after the reconstruction read them: without the distortion of the lens."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.core.inputs import read_image
from massprops.run.job import Job
from massprops.sfm.footage import frame_file, silhouette_file
from massprops.views import Views, undistort


def undistorted_frame(job: Job, views: Views, i: int, flags: int = 1) -> np.ndarray:
    """View i without its lens's distortion: (h, w, 3) uint8 BGR, or (h, w) grey with `flags` 0.

    Raises:
        OSError: the frame is missing or cannot be read.
    """
    image = read_image(frame_file(job.run / "work", views.names[i]), flags)
    return undistort(image, views.K[i], views.distortion[i])


def undistorted_mask(job: Job, views: Views, i: int, last: str = "join") -> np.ndarray:
    """(h, w) uint8 silhouette of view i without its lens's distortion: 255 object, 0 background, 128 not known.

    Args:
        last: as for `silhouette_file`.

    Raises:
        OSError: the silhouette is missing or cannot be read.
    """
    mask = read_image(silhouette_file(job.run / "work", views.names[i], last), 0)
    return undistort(mask, views.K[i], views.distortion[i], nearest=True)


def mask_for_stereo(job: Job, views: Views, i: int, footage: dict[str, Any]) -> np.ndarray:
    """`undistorted_mask` of view i, 0 where a planet's limb or a star shines in nearly all frames of `footage.json`.

    There the silhouette says nothing, but stereo must not measure: clouds and stars stay while the body turns, so their points
    would lie anywhere in the space about it.
    """
    mask = undistorted_mask(job, views, i)
    beside = next((f.get("beside") for f in footage["frames"] if f["name"] == views.names[i]), None)
    if beside is None:
        return mask
    region = undistort(read_image(job.work("capture") / beside, 0), views.K[i], views.distortion[i], nearest=True)
    return np.where(region > 0, np.uint8(0), mask)
