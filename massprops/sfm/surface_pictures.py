"""The pictures in which a surface that stands with the model is followed."""

from __future__ import annotations

import cv2
import numpy as np

from massprops.dense.region import Region, region_of
from massprops.errors import InputError
from massprops.sfm.features import read_mask
from massprops.sfm.footage import FootageRecord
from massprops.sfm.surface_tracks import PIXELS, ROOM_PIXELS, Image
from massprops.sfm.turned import turn_image
from massprops.views import Views, undistort


def surface_pictures(footage: FootageRecord, views: Views, masked: bool) -> tuple[Image | None, int]:
    """The images that show a surface which stands with the model, and how many pixels of each to look at.

    Where the room was used, what stands is what the cameras look at. A body that turns before a still background takes
    part in its own silhouettes only.
    """
    if masked:
        return _pictures(footage, views, None), PIXELS
    if footage.room_stood:
        return _pictures(footage, views, region_of(views)), ROOM_PIXELS
    return None, 0


def _pictures(footage: FootageRecord, views: Views, region: Region | None) -> Image:
    """The views undistorted, turned as their camera's are, with their silhouettes or what they see of the region; one without a
    silhouette shows nothing."""
    frames = {f.name: f for f in footage.frames}

    def image(i: int) -> tuple[np.ndarray, np.ndarray]:
        frame = frames[views.names[i]]
        size = footage.size(frame)
        colour = cv2.imread(str(footage.image(frame.name)))
        if colour is None:
            raise InputError(f"{footage.image(frame.name)}: not a readable image; run the capture stage again")
        K, distortion = views.K[i], views.distortion[i]
        colour = undistort(turn_image(colour, frame.turn), K, distortion)
        if region is not None:
            return colour, region.mask(views, i)
        mask = read_mask(footage, frame.name, size)
        if mask is None:
            mask = np.zeros((size[1], size[0]), np.uint8)
        return colour, undistort(turn_image(mask, frame.turn), K, distortion, nearest=True)

    return image
