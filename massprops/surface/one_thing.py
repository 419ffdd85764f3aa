"""Parts of a still scene that silhouettes show to be one thing: a string too thin to be measured, or cut out, leads from one to the other."""

from __future__ import annotations

import numpy as np

from massprops.geometry.rasterise import silhouette
from massprops.surface.silhouette import FEWEST_AGREE
from massprops.views import Views

APART_PX = 2
"""Distance between two parts as drawn [px], beyond which an image shows whether anything leads from one to the other."""


def hang_together(
    views: Views, masks: list[np.ndarray], vertices: np.ndarray, one: np.ndarray, other: np.ndarray
) -> bool:
    """Whether two parts lie on one piece of the silhouette in most of the images that show them side by side.

    What stands beside an object hangs together with it only where one of them is before the other.

    Args:
        views: n cameras; masks: n undistorted silhouettes (h, w), 255 object.
        vertices: (v, 3); one, other: faces (f, 3) and (g, 3) of the parts.
    """
    import cv2

    wide = np.ones((2 * APART_PX + 1,) * 2, np.uint8)
    shown = together = 0
    for i, mask in enumerate(masks):
        camera = views.K[i], views.R[i], views.t[i], mask.shape[::-1]
        first, second = (silhouette(vertices, faces, *camera) for faces in (one, other))
        near = cv2.dilate(first.astype(np.uint8), wide) > 0
        if not first.any() or not second.any() or (near & second).any():
            continue
        pieces = cv2.connectedComponents((mask == 255).astype(np.uint8), connectivity=8)[1]
        a, b = (_piece_of_most(pieces[drawn]) for drawn in (first, second))
        shown += 1
        together += a == b != 0
    return shown >= FEWEST_AGREE and 2 * together > shown


def _piece_of_most(pieces: np.ndarray) -> int:
    """The piece that more than half of some pixels lie on; 0 of none, or of the background."""
    count = np.bincount(pieces)
    best = int(np.argmax(count))
    return best if 2 * count[best] > len(pieces) else 0
