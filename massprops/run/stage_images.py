"""The images of earlier stages, as the stages after the reconstruction read them: without the distortion of the lens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.inputs import read_image
from massprops.run.job import Job
from massprops.sfm.footage import frame_file
from massprops.views import Views, undistort


def undistorted_frame(job: Job, views: Views, i: int, flags: int = 1) -> np.ndarray:
    """View i without its lens's distortion: (h, w, 3) uint8 BGR, or (h, w) grey with `flags` 0.

    Raises:
        OSError: the frame is missing or cannot be read.
    """
    image = read_image(frame_file(job.run / "work", views.names[i]), flags)
    return undistort(image, views.K[i], views.distortion[i])


def silhouette_file(work: Path, name: str) -> Path:
    """The silhouette of a stored frame in the folder of all stages: as all placements of the object know it, where that
    is known better."""
    again = work / "join" / "masks" / f"{name}.png"
    return again if again.is_file() else _first_silhouette(work, name)


def _first_silhouette(work: Path, name: str) -> Path:
    return work / "silhouettes" / "masks" / f"{name}.png"


def undistorted_mask(job: Job, views: Views, i: int, redrawn: bool = True) -> np.ndarray:
    """(h, w) uint8 silhouette of view i without its lens's distortion: 255 object, 0 background, 128 not known.

    Args:
        redrawn: as all placements know it; else as its own placement does.

    Raises:
        OSError: the silhouette is missing or cannot be read.
    """
    work, name = job.run / "work", views.names[i]
    mask = read_image(silhouette_file(work, name) if redrawn else _first_silhouette(work, name), 0)
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
