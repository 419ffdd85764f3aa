"""How far measured points scatter about a smooth surface, over more than a window of stereo.

Neighbouring pixels share most of their windows, so their depths err alike: within a window points lie on a smooth surface,
wrong or right. Beyond its width errors are independent, and what is rough there is noise, or relief that is as fine.

Where texture is faint, all views err inward by as much as their points scatter: glossy sides show images of the room,
which lie behind a side that bulges, and a minimum cut follows the deepest of what is measured.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.cloud import Cloud

WINDOW = 9.0
"""Width of a window of stereo [px]. Quarters of the measured faces of a rendered plain jug by this scatter within 9 px (0.4, 0.65,
0.9 and 1.3 px) were 0.9, 1.5, 1.8 and 2.9 px off in the mean and -0.3, -0.3, -0.4 and -1.4 px in the middle. By that within 2 px
they all were 1.1 to 1.3 px off."""
FEWEST, MOST = 20, 200
"""Points that a smooth surface is laid through; a random part is taken of more."""
SAMPLES = 2000
"""Points about which the scatter is taken."""
ROUNDS = 3


def face_scatter(
    middle: np.ndarray, observed: np.ndarray, cloud: Cloud, radius: float, rng: np.random.Generator
) -> np.ndarray:
    """Median distance of the points about each measured face from a smooth surface through them.

    Args:
        middle: (f, 3) of the faces; observed: (f,) bool.
        cloud: the points.
        radius: within which they are taken [world units].
        rng: draws the points about which the scatter is taken.

    Returns:
        (f,) [world units], 0 for faces that were not measured.
    """
    from scipy.spatial import cKDTree

    tree, some = cKDTree(cloud.xyz), np.sort(rng.permutation(len(cloud))[:SAMPLES])
    away = np.full(len(some), np.nan)
    for n, (i, near) in enumerate(zip(some, tree.query_ball_point(cloud.xyz[some], radius), strict=True)):
        alike = np.array(near)
        alike = alike[cloud.normal[alike] @ cloud.normal[i] > 0.5]
        if len(alike) > MOST:
            alike = rng.choice(alike, MOST, replace=False)
        if len(alike) >= FEWEST:
            away[n] = _about_quadric((cloud.xyz[alike] - cloud.xyz[i]) / radius, cloud.normal[i]) * radius
    some, away = some[np.isfinite(away)], away[np.isfinite(away)]
    if not len(some):
        return np.zeros(len(middle))
    near = cKDTree(cloud.xyz[some]).query(middle, k=min(8, len(some)))[1].reshape(len(middle), -1)
    return np.where(observed, away[near].mean(axis=1), 0.0)


def _about_quadric(place: np.ndarray, up: np.ndarray) -> float:
    """Median distance of places (n, 3) along up (3,) from the surface of second order that most of them lie on."""
    across = np.linalg.svd(up[None])[2][1:]
    (u, v), height = across @ place.T, place @ up
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    weight = np.ones(len(u))
    for _ in range(ROUNDS):
        found = np.linalg.lstsq(terms * weight[:, None], height * weight, rcond=None)[0]
        off = np.abs(height - terms @ found)
        middle = _median(off)
        weight = 1 / np.sqrt(1 + (off / (3.0 * middle + 1e-12)) ** 2)
    return middle


def _median(few: np.ndarray) -> float:
    """As numpy's, which takes several times as long for so few numbers (n,)."""
    ordered = np.sort(few)
    return float((ordered[(len(few) - 1) // 2] + ordered[len(few) // 2]) / 2)
