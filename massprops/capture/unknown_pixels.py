"""Where a silhouette cannot tell: pixels that look like background but where the reconstruction knows of body.

An unlit side looks like sky. The points of structure from motion were seen in other frames, in other light; where
they project onto background pixels of this frame, the silhouette is not evidence of emptiness there.
"""

from __future__ import annotations

import numpy as np

from massprops.views import AMBIGUOUS

ASKED = 3000
"""Points, evenly spread among all, whose neighbours tell how densely a view was seen. The percentile of 23 000 moves by 1 %."""


def predicted_silhouette(uv: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The area that projected surface points cover, as a closing of the points by twice the 90th percentile of their distance to
    the third neighbour.

    Args:
        uv: (n, 2) pixels.
        shape: height, width.

    Returns:
        (h, w) bool.
    """
    import cv2
    from scipy.spatial import cKDTree

    h, w = shape
    inside = (uv[:, 0] > -0.5) & (uv[:, 1] > -0.5) & (uv[:, 0] < w - 0.5) & (uv[:, 1] < h - 0.5)
    uv = uv[inside]
    if len(uv) < 10:
        return np.zeros(shape, bool)
    distance = cKDTree(uv).query(uv[:: max(1, len(uv) // ASKED)], k=4)[0][:, -1]
    radius = int(np.clip(round(2.0 * float(np.percentile(distance, 90))), 2, 0.04 * np.hypot(h, w)))
    dots = np.zeros(shape, np.uint8)
    pixel = np.round(uv).astype(int)
    dots[pixel[:, 1], pixel[:, 0]] = 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    padded = cv2.copyMakeBorder(dots, radius, radius, radius, radius, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)
    return closed[radius:-radius, radius:-radius] > 0


def with_unknown(mask: np.ndarray, predicted: np.ndarray, margin: int = 2) -> np.ndarray:
    """The mask with `AMBIGUOUS` where it says background and the reconstruction says body.

    Args:
        mask: (h, w) uint8, 255 object, 0 background.
        predicted: (h, w) bool, of `predicted_silhouette`.
        margin: pixels by which the prediction is widened.
    """
    import cv2

    size = 2 * margin + 1
    wide = cv2.dilate(predicted.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    return np.where((mask < AMBIGUOUS) & wide, AMBIGUOUS, mask).astype(np.uint8)
