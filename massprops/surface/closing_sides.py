"""Flat sides of which nothing was measured, where the flat sides beside them end.

A side that the Sun never reached was seen by no camera. But the sides beside it are lit up to their edges, which are its edges, too: where
the straight ends of two of them or more lie in one plane, the body ends in that plane, unless a line of sight passes there. A film
over those edges would close such a side as well, but of two that meet it cuts the corner off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from massprops.surface.cloud import Thinned
from massprops.surface.flat_side import FlatSide, Plane

PARALLEL, UPRIGHT = np.cos(np.radians(8.0)), np.sin(np.radians(15.0))
"""Of normals of one direction, and of sides at a right angle."""
STRIP, FEWEST_POINTS, FEWEST_STRIPS = 2.0, 4, 8
"""Width of the strips of a side in which its end is looked for [spacings], points in one that tells it, and strips of an end."""
STRAIGHT, STRAIGHT_SHARE = 1.5, 0.5
"""How far the strips of a straight end lie from each other at most [spacings], and how many of all strips of a side. Of two bodies in foil
(Blender, 79 and 69) six ends of seven lay within 1 px of the true edges, where a spacing is 1.2 px."""
ONE_PLANE = 3.0
"""How far ends lie from each other at most along a plane's normal, to be of one plane [spacings]; nearer than that to a measured side they
are its own edges."""
BORNE = 0.8
"""Share of the ends of a plane that must bear that it is parallel to a measured side, or at a right angle to two."""
NARROWEST = 4.0
"""1-sigma across the ends of a plane at least [spacings], so that they tell its direction."""


def closing_sides(
    found: Sequence[tuple[np.ndarray, Plane]], thinned: Thinned, empty: Callable[[np.ndarray], np.ndarray]
) -> list[FlatSide]:
    """The sides that close a body where its measured flat sides end, none of them measured.

    Args:
        found: indices of the points of each measured side, and its plane.
        empty: of places (k, 3), which are seen to be empty (k,) bool.
    """
    planes = [plane for _, plane in found]
    out = []
    for direction in _directions([normal for normal, _ in planes]):
        ends = [e for own, plane in found if (e := _end(thinned, own, plane, direction)) is not None]
        for xyz in _in_one_plane(ends, direction, thinned.spacing):
            plane = _through(xyz, direction, thinned.spacing)
            if plane is not None and not _measured(xyz, plane, planes, thinned.spacing):
                out.append(_closed(xyz, plane, thinned.spacing, empty))
    return [side for side in out if side.goes_on.any()]


def _directions(normals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Unit normals (3,) that a side may have which closes others: of these, against them, and across two of them."""
    across = [np.cross(a, b) for a, b in combinations(normals, 2)]
    out: list[np.ndarray] = []
    for way in (*normals, *across):
        length = float(np.linalg.norm(way))
        for unit in (way / length, -way / length) if length > UPRIGHT else ():
            if all(unit @ other < PARALLEL for other in out):
                out.append(unit)
    return out


def _end(thinned: Thinned, own: np.ndarray, plane: Plane, direction: np.ndarray) -> np.ndarray | None:
    """(k, 3) where a side, of points `own`, ends in a direction, strip by strip; None where that does not lie in it, or the end is not
    straight."""
    normal, offset = plane
    if abs(normal @ direction) > UPRIGHT:
        return None
    along = np.cross(normal, direction)
    along /= np.linalg.norm(along)
    outward = np.cross(along, normal)
    xyz, h = thinned.xyz[own], thinned.spacing
    strip = np.floor((xyz @ along - (xyz @ along).min()) / (STRIP * h)).astype(int)
    end = np.full(strip.max() + 1, -np.inf)
    np.maximum.at(end, strip, xyz @ outward)
    told = np.flatnonzero(np.bincount(strip) >= FEWEST_POINTS)
    if len(told) < FEWEST_STRIPS:
        return None
    end = end[told]
    within = np.abs(end[:, None] - end) < STRAIGHT * h
    straight = within[np.argmax(within.sum(axis=0))]
    if straight.mean() < STRAIGHT_SHARE:
        return None
    at = (xyz @ along).min() + STRIP * h * (told[straight] + 0.5)
    return np.asarray(offset * normal + at[:, None] * along + end[straight, None] * outward)


def _in_one_plane(ends: Sequence[np.ndarray], direction: np.ndarray, spacing: float) -> list[np.ndarray]:
    """Places (k, 3) of the ends of two sides or more that lie in one plane, for each such plane."""
    height = np.array([np.median(end @ direction) for end in ends])
    left, out = np.ones(len(ends), bool), []
    for k in range(len(ends)):
        alike = np.flatnonzero(left & (np.abs(height - height[k]) < ONE_PLANE * spacing))
        if left[k] and len(alike) > 1:
            left[alike] = False
            out.append(np.concatenate([ends[j] for j in alike.tolist()]))
    return out


def _through(xyz: np.ndarray, direction: np.ndarray, spacing: float) -> Plane | None:
    """The plane through ends (k, 3), across a direction if most of them bear that; None where they are too narrow to tell a plane, or lie in
    one that does not face it."""
    middle = xyz.mean(axis=0)
    size, axis = np.linalg.svd((xyz - middle) / np.sqrt(len(xyz)), full_matrices=False)[1:]
    normal = axis[2] if axis[2] @ direction > 0 else -axis[2]
    if size[1] < NARROWEST * spacing or normal @ direction < PARALLEL:
        return None
    height = float(np.median(xyz @ direction))
    if (np.abs(xyz @ direction - height) < STRAIGHT * spacing).mean() > BORNE:
        return direction, height
    return normal, float(normal @ middle)


def _measured(xyz: np.ndarray, plane: Plane, planes: Sequence[Plane], spacing: float) -> bool:
    """Whether ends (k, 3) in a plane are those of a measured side."""
    middle = xyz.mean(axis=0)
    return any(n @ plane[0] > PARALLEL and abs(n @ middle - offset) < ONE_PLANE * spacing for n, offset in planes)


def _closed(xyz: np.ndarray, plane: Plane, spacing: float, empty: Callable[[np.ndarray], np.ndarray]) -> FlatSide:
    """The side between ends (k, 3) in its plane, which no line of sight passes."""
    from scipy.spatial import Delaunay

    side = FlatSide.about(xyz, plane, spacing)
    places = side.places(np.ones(side.measured.shape, bool))
    between = Delaunay(xyz @ side.base.T).find_simplex(places @ side.base.T) >= 0
    between[between] = ~empty(places[between])
    return replace(side, goes_on=between.reshape(side.measured.shape))
