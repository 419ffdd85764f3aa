"""Whether an object is whole in the picture."""

from __future__ import annotations

import numpy as np

RING = 3
"""Width of the image's edge [px]: undoing and redoing a lens loses a pixel or two there."""
LEAST = 0.1
"""Length of the edge that the object covers, in equivalent diameters of its silhouette, from which on it is cut off."""


def cut_off(mask: np.ndarray) -> bool:
    """Whether the object goes on beyond the image.

    Args:
        mask: (h, w) uint8, 255 the object.
    """
    on_object = mask == 255
    if not on_object.any():
        return False
    covered = sum(int(side.any(axis).sum()) for side, axis in (
        (on_object[:RING], 0), (on_object[-RING:], 0), (on_object[:, :RING], 1), (on_object[:, -RING:], 1)))  # fmt: skip
    return covered > max(3.0, LEAST * float(np.sqrt(4 / np.pi * np.count_nonzero(on_object))))
