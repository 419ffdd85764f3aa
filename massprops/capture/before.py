"""Whether something stands before the object in an image: a hand, a passer-by."""

from __future__ import annotations

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.geometry.projection import on_pixels

BEHIND = 0.03
"""Points farther behind the shape's surface than this, of their depth, are on its other side."""
HIDDEN, BELOW = 0.2, 6.0
"""Share of the object's points that do not show their colour, above the usual one of all images, from which on something
is before it; and by how many scatters of all images."""
EDGE = 4
"""Pixels along the outline that are left out: there the image blends the object with what is behind it."""


def hidden_share(depth: np.ndarray, uv: np.ndarray, z: np.ndarray, shows: np.ndarray) -> float:
    """Share of the object's points that face the camera and whose colour the image does not have.

    Args:
        depth: (h, w) of the shape, infinite where it is not.
        uv: (m, 2) pixels and z (m,) depths of the object's points.
        shows: (m,) bool, the image has the point's colour there.
    """
    import cv2

    within = cv2.erode(np.isfinite(depth).astype(np.uint8), np.ones((3, 3), np.uint8), iterations=EDGE) > 0
    there, i, j = on_pixels(uv, depth.shape)
    front = np.zeros(len(z), bool)
    front[there] = within[i, j] & (np.abs(z[there] - depth[i, j]) < BEHIND * z[there])
    return float(np.mean(~shows[front])) if front.sum() >= 50 else 0.0


def something_before(share: np.ndarray) -> np.ndarray:
    """(n,) bool: images in which much more of the object is hidden than usual; share (n,) of `hidden_share`.

    Gloss hides colours too, but in all images alike.
    """
    middle = float(np.median(share))
    scatter = max(mad_sigma(share - middle), 0.02)
    return (share > middle + HIDDEN) & (share > middle + BELOW * scatter)
