"""Matches where a model predicts them: each feature has one place to be looked for in the next image.

Where a pattern repeats, a feature's look does not say which of its twins it is; its place does, once poses are known
roughly. The depth of a feature is that of the tracks beside it, so that its place in another image is known to some
pixels, far less than the pattern's period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.geometry.epipolar import fundamental, sampson
from massprops.sfm.gated_search import between, likest, within
from massprops.sfm.points import SparsePoints, project_camera
from massprops.views import Views

BESIDE = 5
"""Tracks that give a feature's depth."""

ALIKE_DEG = 30.0
"""Angle between two rays to a point within which both views see the surface about it."""

MOST_GATES = 4
"""Features whose depth leaves more than this many gates open are not looked for."""


@dataclass(frozen=True)
class Gate:
    """How far from its predicted place a feature is looked for, beside what its depth leaves open, and how far from the
    epipolar line; in longer sides of the image."""

    place: float
    line: float


@dataclass(frozen=True)
class Placed:
    """Features of a placed image: places uv (k, 2), centres of pixels at whole numbers [px]; rays (k, 3) of unit depth
    in camera axes; nearest and farthest depth (k, 2) of the tracks beside each, nan where there are none."""

    uv: np.ndarray
    ray: np.ndarray
    depth: np.ndarray


def place(views: Views, points: SparsePoints, i: int, uv: np.ndarray, lent: bool = False) -> Placed:
    """Rays and depths of the features uv (k, 2) of view i.

    Args:
        lent: depths come from what views from like directions saw, too: view i was placed by few points, and only beside
            these is its own depth known.
    """
    from scipy.spatial import cKDTree

    ray = rays(uv, views.K[i], views.distortion[i])
    of_view = points.obs_view == i
    at, xyz = points.obs_uv[of_view], points.xyz[points.obs_point[of_view]]
    if lent:
        index, more = seen_alike(views, points, i)
        at, xyz = np.concatenate([at, more]), np.concatenate([xyz, points.xyz[index]])
    z = xyz @ views.R[i][2] + views.t[i][2]
    if len(z) < BESIDE:
        return Placed(uv, ray, np.full((len(uv), 2), np.nan))
    _, near = cKDTree(at).query(uv, k=BESIDE)
    beside = np.sort(z[near], axis=1)
    # without the two extremes, so that one wrong track, or one on another surface, opens no gate
    return Placed(uv, ray, beside[:, [1, -2]])


def rays(uv: np.ndarray, K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """(k, 3) rays of unit depth, in camera axes, of places uv (k, 2) in the image, centres of pixels at whole numbers [px]."""
    import cv2

    xy = cv2.undistortPoints(uv.astype(np.float64).reshape(-1, 1, 2), K, distortion).reshape(-1, 2) if len(uv) else uv
    return np.column_stack([xy, np.ones(len(uv))])


def seen_alike(views: Views, points: SparsePoints, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Points that other views saw from within `ALIKE_DEG` and that fall in view i: their numbers (m,) and places (m, 2)."""
    alike = (cosines(views, points, views.centres[i]) > np.cos(np.deg2rad(ALIKE_DEG))) & (points.obs_view != i)
    index = np.unique(points.obs_point[alike])
    camera = points.xyz[index] @ views.R[i].T + views.t[i]
    at, inside = in_frame(camera, views.K[i], views.distortion[i], views.size[i])
    return index[inside], at[inside]


def cosines(views: Views, points: SparsePoints, centre: np.ndarray) -> np.ndarray:
    """(k,) of the angle at each observation's point between its view and a camera at `centre` (3,)."""
    rays = [points.xyz[points.obs_point] - c for c in (views.centres[points.obs_view], centre)]
    lengths = np.prod([np.linalg.norm(r, axis=1) for r in rays], axis=0)
    return np.asarray(np.einsum("ki,ki->k", *rays) / np.maximum(lengths, 1e-12))


def in_frame(
    camera: np.ndarray, K: np.ndarray, distortion: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (m, 2) [px] of points (m, 3) in camera axes, and which of them (m,) lie in the image of `size` (2,)."""
    with np.errstate(all="ignore"):
        at = project_camera(K[None], distortion[None], camera)
        return at, (camera[:, 2] > 0) & (at >= 0).all(1) & (at < size).all(1)


def match_placed(
    views: Views, pair: tuple[int, int], placed: tuple[Placed, Placed], units: tuple[np.ndarray, np.ndarray], gate: Gate
) -> np.ndarray:
    """(m, 2) uint32: places of features of two views that match within each other's gates.

    Args:
        units: (k, 128) unit descriptors of either view.
    """
    first, rows = _best(views, pair, placed, units, gate)
    second, back = _best(views, pair[::-1], placed[::-1], units[::-1], gate)
    partner = np.full(len(placed[1].uv), -1)
    partner[back] = second
    mutual = partner[first] == rows
    return np.column_stack([rows[mutual], first[mutual]]).astype(np.uint32)


def match_onto(
    views: Views, pair: tuple[int, int], placed: tuple[Placed, Placed], units: tuple[np.ndarray, np.ndarray], gate: Gate
) -> np.ndarray:
    """(m, 2) uint32: as `match_placed`, onto a view in which no depth is known yet: the pose of the second is a guess."""
    other, rows = _best(views, pair, placed, units, gate)
    angle = between(*units, rows, other)
    order = np.argsort(angle, kind="stable")
    # a feature that several are likest to belongs to the likest of them
    _, once = np.unique(other[order], return_index=True)
    kept = order[np.sort(once)]
    return np.column_stack([rows[kept], other[kept]]).astype(np.uint32)


def _best(
    views: Views, pair: tuple[int, int], placed: tuple[Placed, Placed], units: tuple[np.ndarray, np.ndarray], gate: Gate
) -> tuple[np.ndarray, np.ndarray]:
    """The likest feature of the second view for features of the first that have one, and the numbers of these."""
    (_, j), (a, b), (unit_a, unit_b) = pair, placed, units
    rows, middle, reach = _predicted(views, pair, a, gate)
    which, other = within(b.uv, middle, reach)
    side = float(views.size[j].max())
    close = off_line(views, pair, a.ray[rows[which]], b.ray[other]) < gate.line * side
    which, other = which[close], other[close]
    if not len(which):
        return other, which
    which, other = likest(which, other, between(unit_a, unit_b, rows[which], other), b.uv)
    return other, rows[which]


def _predicted(views: Views, pair: tuple[int, int], a: Placed, gate: Gate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features of the first view that may be seen in the second, where (k, 2), and within what radius (k,) [px]."""
    i, j = pair
    K, D = views.K[j][None], views.distortion[j][None]
    R = views.R[j] @ views.R[i].T
    t = views.t[j] - R @ views.t[i]
    radius = gate.place * float(views.size[j].max())
    with np.errstate(all="ignore"):
        ends = [(a.ray * a.depth[:, k : k + 1]) @ R.T + t for k in (0, 1)]
        near, far = (project_camera(K, D, c) for c in ends)
        seen = (ends[0][:, 2] > 0) & (ends[1][:, 2] > 0) & np.isfinite(near).all(1) & np.isfinite(far).all(1)
        middle, reach = 0.5 * (near + far), radius + 0.5 * np.linalg.norm(far - near, axis=1)
        inside = (middle > -radius).all(1) & (middle < views.size[j] + radius).all(1)
        rows = np.flatnonzero(seen & inside & (reach < MOST_GATES * radius))
    return rows, middle[rows], reach[rows]


def off_line(views: Views, pair: tuple[int, int], ray: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(k,) distance of rays (k, 3) of two views from their epipolar geometry [px] (`sampson`)."""
    i, j = pair
    F = fundamental((views.K[i], views.K[j]), (views.R[i], views.R[j]), (views.t[i], views.t[j]))
    return sampson(F, ray @ views.K[i].T, other @ views.K[j].T)


def joined(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Matches (m, 2) of both, those of the first where a feature would be matched twice."""
    fresh = ~np.isin(second[:, 0], first[:, 0]) & ~np.isin(second[:, 1], first[:, 1])
    return np.concatenate([first, second[fresh]])
