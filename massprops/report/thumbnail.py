"""A picture with a silhouette laid over it."""

from __future__ import annotations

import numpy as np

from massprops.views import AMBIGUOUS

OBJECT_COLOUR, AMBIGUOUS_COLOUR = (96, 220, 110), (40, 60, 230)  # BGR
SPECK = 12
"""Area [px] of outlines that are noise at the size of a thumbnail."""


def thumbnail(image: np.ndarray, mask: np.ndarray | None, width: int) -> np.ndarray:
    """A thumbnail of an image, the object outlined, what is ambiguous tinted.

    Args:
        image: (h, w, 3) uint8 BGR.
        mask: (h, w) uint8, 255 object, 0 not, 128 cannot tell; None for the image alone.
        width: of the thumbnail [px].
    """
    import cv2

    small = (width, max(1, round(width * image.shape[0] / image.shape[1])))
    out: np.ndarray = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    if mask is None:
        return out
    shown = cv2.resize(mask, small, interpolation=cv2.INTER_NEAREST)
    ambiguous = shown == AMBIGUOUS
    out[ambiguous] = (0.6 * out[ambiguous] + 0.4 * np.array(AMBIGUOUS_COLOUR)).astype(np.uint8)
    lines, _ = cv2.findContours((shown > 0).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(out, [c for c in lines if cv2.contourArea(c) > SPECK], -1, OBJECT_COLOUR, 1)
    return out
