"""What the supports of two placements say of how the body lay on them."""

from __future__ import annotations

import numpy as np

from massprops.surface.answers import APART_DEG
from massprops.surface.placed import Placed

LOWEST, DOWN = 0.01, 0.1
"""Share of a placement's measured points that lie lower than what it rests on once it is turned over, and least share of them that
must face down, so that this side was measured. At the true turns of five things (Blender) the lowest hundredth lay 1.0 px
above the other's support in the mean, -0.9 to 2.6; a banana laid by its outlines was pushed 5 to 7 px through it."""


def same_side(first: Placed, second: Placed, R: np.ndarray) -> bool:
    """Whether the body, the second placement turned by R (3, 3), lies on the same side in both; False where that is unknown."""
    if first.support is None or second.support is None:
        return False
    return bool(first.support[:3] @ R @ second.support[:3] > np.cos(np.deg2rad(APART_DEG)))


def resting(first: Placed, second: Placed, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The shift (3,) of the second placement, next to t, with which the lowest of each lies on what the other stood on.

    Outlines let two flat sides slide into each other. Only sides that were measured count.
    """
    rows, heights = [], []
    ways = ((first, second, R, t, np.eye(3)), (second, first, R.T, -R.T @ t, -R))
    for below, above, turn, shift, carried in ways:
        if below.support is None or not len(above.cloud):
            continue
        up = below.support[:3]
        if np.mean(above.cloud.normal @ turn.T @ up < -0.5) > DOWN:
            rows.append(carried @ up)
            heights.append(np.quantile((above.cloud.xyz @ turn.T + shift) @ up + below.support[3], LOWEST))
    # of two supports that are next to parallel only the mean height tells
    return t - np.linalg.lstsq(np.array(rows), np.array(heights), rcond=0.5)[0] if rows else t
