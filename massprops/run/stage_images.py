"""The images of earlier stages, as the stages after the reconstruction read them: without the distortion of the lens."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from massprops.core.inputs import read_image
from massprops.run.job import Job
from massprops.sfm.footage import frame_file, mask_file, silhouette_file
from massprops.views import Views, undistort

GAP = 1 / 60
"""Half width, over the shorter side of an image, of gaps in what moves that are closed. Set on one film, of a figure of the wood's colour."""


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


def undistorted_sky(job: Job, views: Views, i: int) -> np.ndarray:
    """(h, w) bool: pixels of view i as dark as the sky, whatever later stages know of them, without its lens's distortion; none where it has no
    first silhouette."""
    file = mask_file(job.run / "work", views.names[i])
    if not file.is_file():
        return np.zeros(views.size[i, ::-1], bool)
    return undistort(read_image(file, 0), views.K[i], views.distortion[i], nearest=True) == 0


def turns(footage: dict[str, Any]) -> bool:
    """Whether something turns before a still camera and a room; footage as in `footage.json`."""
    return footage["background"] == "still" and footage["motion"] == "tumbling" and not footage["masks_given"]


def still_backgrounds(job: Job, views: Views) -> list[np.ndarray] | None:
    """(h, w) bool of each view, without its lens's distortion: where it shows what stands still while the object turns; None of other
    footage.

    Parts of the object that look like what is behind them are gaps in what moves: they are closed first.
    """
    files = [mask_file(job.run / "work", name) for name in views.names]
    if not all(file.is_file() for file in files):
        return None
    if not turns(json.loads((job.work("capture") / "footage.json").read_text())):
        return None
    lenses = zip(files, views.K, views.distortion, strict=True)
    return [undistort(_stands_still(read_image(f, 0)), K, d, nearest=True) > 0 for f, K, d in lenses]


def _stands_still(moves: np.ndarray) -> np.ndarray:
    """(h, w) uint8, 255 off what moves, (h, w) uint8, and off its gaps."""
    import cv2
    from scipy.ndimage import binary_fill_holes

    side = 2 * round(GAP * min(moves.shape)) + 1
    closed = cv2.morphologyEx(moves, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8)) > 0
    return np.where(binary_fill_holes(closed), np.uint8(0), np.uint8(255))


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
