"""Parts of images."""

from __future__ import annotations

import numpy as np


def box_about(region: np.ndarray, margin: int = 1) -> tuple[slice, slice]:
    """Rows and columns of the smallest box about the pixels of `region` (h, w) uint8 that are not 0, of which there are some, with a margin
    as far as the image goes.

    Connected parts of a region, and distances in it to the nearest pixel beside it, are those of its box.
    """
    import cv2

    x, y, width, height = cv2.boundingRect(region)
    return slice(max(0, y - margin), y + height + margin), slice(max(0, x - margin), x + width + margin)


def grown(where: np.ndarray, by: int) -> np.ndarray:
    """(h, w) bool: pixels of `where`, (h, w) bool, and those within a disk of radius `by` [px] about them."""
    import cv2

    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1, 2 * by + 1))
    return np.asarray(cv2.dilate(where.astype(np.uint8), disk) > 0)
