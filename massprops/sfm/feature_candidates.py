"""Where features of one model may be seen again in the images of another that is thought to lie near."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from massprops.geometry.vectors import unit
from massprops.sfm.consensus import Candidates
from massprops.sfm.distinct import APART, angles
from massprops.sfm.points import SparsePoints, projected
from massprops.views import Views

WIDEST_DEG = 80.0
"""Angle between two lines of sight above which no surface is seen well from both."""

TARGETS = 3
"""Images of the other model in which a point is looked for, those from the most alike directions."""

RATIO = 0.85
"""Of the angle between matching descriptors to that of the next best within reach."""

WIDEST = 0.8
"""Angle between descriptors above which nothing matches [rad]."""


def feature_candidates(
    views: Views,
    points: SparsePoints,
    own: np.ndarray,
    reach: float,
    looks: np.ndarray,
    features: list[tuple[np.ndarray, np.ndarray]],
) -> Candidates:
    """Features of the other views that look like points of the views `own`, near where these should be seen.

    Args:
        own: (n,) bool.
        reach: how far from there [px].
        looks: (k, 128) unit descriptor of each observation of the points; nan where it has none.
        features: of every view, places (f, 2) and unit descriptors (f, 128).
    """
    others = np.flatnonzero(~own)
    use = np.flatnonzero(own[points.obs_view] & np.isfinite(looks[:, 0]))
    v, p = points.obs_view[use], points.obs_point[use]
    sight = unit(points.xyz[p] - views.centres[v])
    out = []
    for j in others.tolist():
        cosine = np.einsum("ki,ki->k", sight, unit(points.xyz[p] - views.centres[j]))
        # of a point's observations the one from the most alike direction
        order = np.lexsort((-cosine, p))
        first = order[np.r_[True, np.diff(p[order]) > 0]] if len(order) else order
        first = first[cosine[first] > np.cos(np.deg2rad(WIDEST_DEG))]
        if not len(first) or not len(features[j][0]):
            continue
        at = projected(views, np.full(len(first), j), points.xyz[p[first]])
        row, uv = _alike(at, looks[use[first]], features[j], reach)
        out.append((p[first[row]], np.full(len(row), j), uv, cosine[first[row]]))
    if not out:
        return Candidates(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)))
    point, view, uv, cosine = (np.concatenate(x) for x in zip(*out, strict=True))
    order = np.lexsort((-cosine, point))
    begin = np.flatnonzero(np.r_[True, np.diff(point[order]) > 0])
    rank = np.arange(len(order)) - np.repeat(begin, np.diff(np.r_[begin, len(order)]))
    kept = np.sort(order[rank < TARGETS])
    return Candidates(point[kept], view[kept], uv[kept])


def _alike(
    at: np.ndarray, looks: np.ndarray, features: tuple[np.ndarray, np.ndarray], reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (r,) of the places `at` (m, 2) near which one feature is most alike, and where it is (r, 2)."""
    places, described = features
    rows, positions = [], []
    for k, near in enumerate(cKDTree(places).query_ball_point(at, reach)):
        if not near:
            continue
        angle = angles(described[near] @ looks[k])
        best = int(np.argmin(angle))
        # a place may hold several features
        elsewhere = np.linalg.norm(places[near] - places[near[best]], axis=1) > 0.5 * APART
        if angle[best] < WIDEST and angle[best] < RATIO * angle[elsewhere].min(initial=np.pi / 2):
            rows.append(k)
            positions.append(places[near[best]])
    return np.array(rows, int), np.array(positions, float).reshape(-1, 2)
