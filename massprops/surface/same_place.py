"""Whether two groups of images that were taken for two placements show the object in the same place.

Views of a plain side share no features, and look like views of another placement. But the room stayed, so the poses of
both are known in one frame: where an object did not move, the points that both measured lie on each other as they are,
and have the same paint. One that was turned shows another side there, or nothing.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.cloud import Cloud
from massprops.surface.paint import correlation, texture

NEAR_PX = 2.0
"""Points of both parts this near to each other are of one place [px]."""
LEAST_POINTS = 200
"""Points in common below which the paint says nothing."""
SAME_PAINT = 0.5
"""Correlation of the paint above which it is the same. Wrong ways of laying placements onto each other scatter about 0 by
0.03 to 0.12 (rendered padlock, tin, bottle); a bottle that stood had 0.7."""


def colour_correlation(first: Cloud, second: Cloud, colours: tuple[np.ndarray, np.ndarray], pixel: float) -> float:
    """Correlation of the colours of points that coincide without any motion; 0 if there are few.

    Args:
        first, second: measured points in one frame; colours: (n, 3) and (m, 3) uint8 of both.
        pixel: size of a pixel at the object [units of the clouds].
    """
    from scipy.spatial import cKDTree

    away, index = cKDTree(first.xyz).query(second.xyz)
    alike = np.einsum("ij,ij->i", first.normal[index], second.normal) > 0.5
    use = alike & (away < NEAR_PX * pixel)
    if use.sum() < LEAST_POINTS:
        return 0.0
    one = texture(first.xyz, colours[0], first.xyz[index[use]])
    other = texture(second.xyz, colours[1], second.xyz[use])
    return correlation(one, other)


def groups_in_place(alike: np.ndarray) -> np.ndarray:
    """(n,) number of the group of parts that stood in one place, the least of its members; alike (n, n): of
    `colour_correlation`, for each pair once."""
    from scipy.sparse.csgraph import connected_components

    group = connected_components(np.maximum(alike, alike.T) > SAME_PAINT, directed=False)[1]
    return np.array([np.flatnonzero(group == g)[0] for g in group], int)
