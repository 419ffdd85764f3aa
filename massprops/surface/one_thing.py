"""Parts of a still scene that silhouettes show to be one thing: a string too thin to be measured, or cut out, leads from one to the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprops.geometry.rasterise import silhouette
from massprops.surface.silhouette import FEWEST_AGREE
from massprops.views import Views

APART_PX = 2
"""Distance between two parts as drawn [px], beyond which an image shows whether anything leads from one to the other."""


def hang_together(
    views: Views, masks: list[np.ndarray], vertices: np.ndarray, body: np.ndarray, parts: Sequence[np.ndarray]
) -> np.ndarray:
    """(k,) bool: parts that lie on one piece of the silhouette with a body in most of the images that show them beside it.

    What stands beside an object hangs together with it only where one of them is before the other.

    Args:
        views: n cameras; masks: n undistorted silhouettes (h, w), 255 object.
        vertices: (v, 3); body: its faces (f, 3); parts: k, the faces (g, 3) of each.
    """
    import cv2

    wide = np.ones((2 * APART_PX + 1,) * 2, np.uint8)
    shown, together = np.zeros(len(parts), int), np.zeros(len(parts), int)
    for i, mask in enumerate(masks):
        camera = views.K[i], views.R[i], views.t[i], mask.shape[::-1]
        drawn_body = silhouette(vertices, body, *camera)
        if not drawn_body.any():
            continue
        near = cv2.dilate(drawn_body.astype(np.uint8), wide) > 0
        pieces = cv2.connectedComponents((mask == 255).astype(np.uint8), connectivity=8)[1]
        piece_of_body = _piece_of_most(pieces[drawn_body])
        for k, part in enumerate(parts):
            drawn = silhouette(vertices, part, *camera)
            if drawn.any() and not (near & drawn).any():
                shown[k] += 1
                together[k] += piece_of_body == _piece_of_most(pieces[drawn]) != 0
    return np.asarray((shown >= FEWEST_AGREE) & (2 * together > shown))


def _piece_of_most(pieces: np.ndarray) -> int:
    """The piece that more than half of some pixels lie on; 0 of none, or of the background."""
    count = np.bincount(pieces)
    best = int(np.argmax(count))
    return best if 2 * count[best] > len(pieces) else 0
