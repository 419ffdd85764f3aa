"""Flat sides of a body, and where they go on in space that nothing measured.

What was made goes on straight: a panel whose back was lit at its tip only is as flat near its hinge. Between the two flat
sides of such a corner lies nothing, though the silhouettes' hull and the film of least area both close it with a web. So each flat side
is continued over what no line of sight and no silhouette calls empty, as far as another side that it meets (as in the
piecewise planar completion of Chauve, Labatut and Pons 2010), and space in front of such a continuation is not pulled in. A side of which
nothing at all was measured lies where those beside it end (`massprops.surface.closing_sides`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from massprops.surface.closing_sides import closing_sides
from massprops.surface.cloud import Thinned
from massprops.surface.flat_side import FlatSide, Plane
from massprops.surface.silhouette import Hull
from massprops.views import Views

FACING = np.cos(np.radians(25.0))
"""Of a point's normal with that of its side: those of single points scatter by about 10 degrees."""
SMALLEST = 0.005
"""Share of all points that a flat side holds at least: of a CubeSat's 55 000 points the seen strip of its panel's back held 1300, half a
bus side 300. This and the numbers of places below were set on four path-traced films (CubeSats 9 and 11, foil 9 and 11)."""
ROUND = 1.3
"""A flat side has about as many points within twice its band as within it: a ball twice as many, a cylinder 1.4 times."""
TRIES, FITS, MOST = 100, 3, 24
"""Places at which a side is looked for, each time, how often a plane is fitted to the points on it, and sides at most."""
NEIGHBOURS = 50
"""Points that a side is first fitted to."""
BLOCK, SEEN = 4, 3
"""Pixels of a side of the squares in which lines of sight are gathered, and views that must look through a place for it to be empty."""
THIN, RIM = 0.15, 0.5
"""Room behind a side, of its width, within which it may be a plate, and the share of its rim where that is so."""
ALIKE, BORNE = np.cos(np.radians(8.0)), 0.8
"""Of normals of sides that may be parallel, and the share of a side's points that must bear it."""
SEEN_BACK = 0.1
"""Share of a side's rim behind which another side was measured, above which its back is known. Of any other shape it is so where a point
was measured for each of its places; of what was seen, about two are."""
TIGHTEST = 0.1
"""Quantile of that room along the rim which bounds how thick a plate is. Of CubeSats whose panels were measured on both sides it was
3.0 (2 px), 4 and 1.1 times what they measured."""
SEAM, WITHIN = 3, 2
"""Places by which the end of a side may be off, and how far within its end another side that meets it stops: what was measured is grown
by one."""
ALONG = np.cos(np.radians(20.0))
"""Of normals of sides that do not meet."""


def flat_sides(thinned: Thinned, hull: Hull, views: Views, seed: int = 0) -> list[FlatSide]:
    """The flat sides of a body, each continued as far as it may go, and those that close them; none where none goes on.

    Args:
        thinned: measured points; hull: what silhouettes leave; views: that the points were measured in.
        seed: of the places at which sides are looked for.
    """
    flat_parts = measured_sides(thinned, seed)
    first = [_continued(thinned, hull, views, points, plane) for points, plane in flat_parts]
    first = [side for side in first if side.measured.any()]
    first += [back for side in first for back in _back(side, first, thinned, hull)]
    closing = closing_sides(flat_parts, thinned, partial(_seen_empty, thinned, views))
    others = first + closing
    last = [_until_its_end(_until_others(side, others), others) for side in first]
    last += closing
    return last if any(side.goes_on.any() for side in last) else []


def enclosed(sides: Sequence[FlatSide], xyz: np.ndarray) -> np.ndarray:
    """(k,) bool: points (k, 3) that lie between two sides which face away from each other, in two directions at least."""
    return np.sum([_between(alike, xyz) for alike in _by_direction(sides)], axis=0) > 1


def _between(alike: list[FlatSide], xyz: np.ndarray, wider: int = 0) -> np.ndarray:
    """(k,) bool: of parallel sides, the nearest above and the nearest below points (k, 3) both have them behind.

    Args:
        wider: places by which sides are grown for this, or shrunk where it is negative; those that points lie before are grown by
            `SEAM` in either case.
    """
    from scipy.ndimage import binary_closing

    nearest, shut = np.full((2, len(xyz)), np.inf), np.zeros((2, len(xyz)), bool)
    for side in alike:
        height = side.height(xyz)
        # what stands on a side, such as a panel, hides a strip of it
        whole = binary_closing(np.pad(side.measured | side.goes_on, SEAM), iterations=SEAM)[SEAM:-SEAM, SEAM:-SEAM]
        if wider < 0:  # and shades more of it, where the panel does not go on into what it stands on
            whole = whole | _wider(_convex(whole), 3 * wider)
        on = np.where(height > 0, side.on(xyz, _wider(whole, SEAM if wider else 0)), side.on(xyz, _wider(whole, wider)))
        # which way from the points it lies
        above = (height < 0) == (side.normal @ alike[0].normal > 0)
        for way, there in enumerate((above, ~above)):
            closer = on & there & (np.abs(height) < nearest[way])
            nearest[way, closer] = np.abs(height[closer])
            shut[way, closer] = height[closer] < 0
    return np.asarray(shut.all(0))


def _convex(where: np.ndarray) -> np.ndarray:
    """(a, b) bool, with what lies between its places."""
    import cv2

    out = np.zeros(where.shape, np.uint8)
    if where.any():
        cv2.fillConvexPoly(out, cv2.convexHull(np.argwhere(where)[:, ::-1].astype(np.int32)), 1)
    return out > 0


def _wider(where: np.ndarray, places: int) -> np.ndarray:
    """(a, b) bool, grown by so many places, or shrunk by as many where they are negative."""
    from scipy.ndimage import binary_dilation, binary_erosion

    if places == 0:
        return where
    return np.asarray((binary_dilation if places > 0 else binary_erosion)(where, iterations=abs(places)))


def in_front(sides: Sequence[FlatSide], xyz: np.ndarray) -> np.ndarray:
    """(k,) bool: the nearest side above or below points (k, 3), measured or continued, has them in front of it."""
    nearest = np.full(len(xyz), np.inf)
    front = np.zeros(len(xyz), bool)
    for side in sides:
        height = side.height(xyz)
        closer = (np.abs(height) < nearest) & side.on(xyz, side.measured | side.goes_on)
        nearest[closer] = np.abs(height[closer])
        front[closer] = height[closer] > 0
    return front


def measured_sides(thinned: Thinned, seed: int) -> list[tuple[np.ndarray, Plane]]:
    """Indices of the points of each flat side that was measured, and its plane; the largest first."""
    from scipy.spatial import cKDTree

    tree, band = cKDTree(thinned.xyz), _band(thinned)
    rng = np.random.default_rng([seed, 29])
    remaining = np.ones(len(thinned.xyz), bool)
    out: list[tuple[np.ndarray, Plane]] = []
    least = max(2 * NEIGHBOURS, int(SMALLEST * len(remaining)))
    for _ in range(MOST):
        if remaining.sum() < least:
            break
        start = rng.choice(np.flatnonzero(remaining), TRIES)
        near = tree.query(thinned.xyz[start], 2 * NEIGHBOURS)[1]  # of a thin part both sides
        alike = [n[thinned.normal[n] @ thinned.normal[s] > FACING] for s, n in zip(start, near, strict=True)]
        points, plane = max(
            (_grown(thinned, points, remaining, band) for points in alike), key=lambda found: len(found[0])
        )
        if len(points) < least:
            break
        wide = np.flatnonzero(remaining & _near(thinned, plane, 2 * band))
        remaining[wide] = False
        if len(wide) < ROUND * len(points):
            out.append((wide, _parallel(thinned, points, plane, [p for _, p in out])))
    return out


def _grown(thinned: Thinned, own: np.ndarray, left: np.ndarray, band: float) -> tuple[np.ndarray, Plane]:
    """Points of those that are `left` (m,) bool on the plane through points `own`, and that plane."""
    plane = np.array([0.0, 0.0, 1.0]), np.inf
    for _ in range(FITS):
        if len(own) < NEIGHBOURS // 2:
            return np.zeros(0, np.int64), plane
        plane = _fit(thinned, own)
        own = np.flatnonzero(left & _near(thinned, plane, band))
    return own, plane


def _parallel(thinned: Thinned, own: np.ndarray, plane: Plane, larger: list[Plane]) -> Plane:
    """A side's plane, parallel to a larger one if most of its points (k,) bear that."""
    for other, _ in larger:
        if abs(other @ plane[0]) > ALIKE:
            turned = other if other @ plane[0] > 0 else -other
            height = thinned.xyz[own] @ turned
            middle = float(np.median(height))
            if (np.abs(height - middle) < 2 * _band(thinned)).mean() > BORNE:
                return turned, middle
    return plane


def _band(thinned: Thinned) -> float:
    """Distance from a plane within which points belong to it [world units]."""
    return float(max(np.median(thinned.sigma), 0.3 * thinned.spacing))


def _fit(thinned: Thinned, own: np.ndarray) -> Plane:
    """The plane of least squares through points, its normal outward."""
    xyz = thinned.xyz[own]
    middle = xyz.mean(0)
    normal = np.linalg.eigh(np.cov((xyz - middle).T))[1][:, 0]
    normal = normal if normal @ thinned.normal[own].sum(0) > 0 else -normal
    return normal, float(normal @ middle)


def _near(thinned: Thinned, plane: Plane, band: float) -> np.ndarray:
    """(m,) bool: points that lie on a plane and face as it does."""
    normal, offset = plane
    return np.asarray((np.abs(thinned.xyz @ normal - offset) < band) & (thinned.normal @ normal > FACING))


def _continued(thinned: Thinned, hull: Hull, views: Views, own: np.ndarray, plane: Plane) -> FlatSide:
    """A side on its grid, continued within the hull over what was not measured, as if there were no others."""
    from scipy.ndimage import binary_dilation
    from scipy.spatial import cKDTree

    side, normal = FlatSide.about(thinned.xyz, plane, thinned.spacing), plane[0]
    size = side.measured.shape
    measured = binary_dilation(_whole(side.place(thinned.xyz[own]), size))
    places = side.places(np.ones(size, bool))
    free = ((hull.value(places) < 0) & ~_seen_empty(thinned, views, places)).reshape(size)
    # the other side of a thin part may be nearer than neighbouring points
    others = thinned.normal @ normal > -FACING
    others[own] = False
    if others.any():
        near = cKDTree(thinned.xyz[others]).query(places, distance_upper_bound=thinned.spacing)[0]
        free &= ~np.isfinite(near).reshape(size)
    return _reached(replace(side, measured=measured), free)


def _back(side: FlatSide, others: list[FlatSide], thinned: Thinned, hull: Hull) -> list[FlatSide]:
    """The other side of a plate of which nothing was measured, if silhouettes show it to be one: they end next to most of its rim."""
    from scipy.ndimage import binary_erosion

    inner = binary_erosion(side.measured, iterations=2)
    rim = inner & ~binary_erosion(inner)
    if not rim.any():
        return []
    width = side.step * np.sqrt(side.measured.sum())
    start = side.places(rim)
    height = side.height(thinned.xyz)
    behind = (height < -_band(thinned)) & (height > -THIN * width) & (thinned.normal @ side.normal < 0)
    if (behind & side.on(thinned.xyz, side.measured)).sum() > side.measured.sum():
        return []
    for other in others:
        if other.normal @ side.normal < -FACING:
            near = np.abs(other.height(start)) < THIN * width
            if (other.on(start, other.measured) & near).mean() > SEEN_BACK:
                return []
    room = hull.room(start, np.tile(-side.normal, (len(start), 1)), width)
    thin = (room > 0) & (room < THIN * width)
    if thin.mean() < RIM:
        return []
    # the tightest silhouettes look along it; they are about a pixel too wide, or more if none looks quite along it
    most = float(np.quantile(room[thin], TIGHTEST))
    thick = max(0.5 * most, 0.75 * most - 0.5 * hull.pixel)
    measured = np.zeros(side.measured.shape, bool)
    measured[tuple(np.argwhere(rim)[thin].T)] = True
    return [
        replace(
            side, normal=-side.normal, offset=thick - side.offset, measured=measured, goes_on=side.measured & ~measured
        )
    ]


def _whole(at: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """(a, b) bool: places (k, 2) of points on a grid, less strips, as along an edge that noise has rounded, and small patches."""
    from scipy.ndimage import binary_closing, binary_opening, label

    points = np.zeros(size, np.int64)
    np.add.at(points, tuple(at.T), 1)
    whole = binary_opening(binary_closing(points > 0, np.ones((3, 3))), np.ones((3, 3)))
    part, count = label(whole, np.ones((3, 3)))
    held = np.bincount(part.ravel(), points.ravel(), minlength=count + 1) >= 2 * NEIGHBOURS
    held[0] = False
    return np.asarray(held[part])


def _until_others(side: FlatSide, others: list[FlatSide]) -> FlatSide:
    """A side that ends where it would come to lie between others, measured or continued; and that goes on to where they end, though
    silhouettes show sky there: an end that turns away from the Sun looks like it."""
    across = _by_direction([other for other in others if abs(other.normal @ side.normal) < ALONG])
    xyz = side.places(np.ones(side.measured.shape, bool))
    within, along = np.zeros(len(xyz), bool), np.zeros(len(xyz), bool)
    for alike in across:
        within |= _between(alike, xyz, -WITHIN)
        along |= _between(alike, xyz, SEAM)
    shape = side.measured.shape
    return _reached(side, (side.goes_on | along.reshape(shape)) & ~within.reshape(shape) & ~side.measured)


def _until_its_end(side: FlatSide, others: Sequence[FlatSide]) -> FlatSide:
    """A side that goes on no farther than another beside it, which has what was measured of it behind."""
    start, places = side.places(side.measured), side.places(side.goes_on)
    kept = np.ones(len(places), bool)
    for other in others:
        if abs(other.normal @ side.normal) < ALONG:
            height = other.height(start)
            beside = np.abs(height) < SEAM * side.step
            beside &= other.on(start, _wider(other.measured | other.goes_on, SEAM))
            if beside.any() and (height < SEAM * side.step).mean() > BORNE:
                kept &= other.height(places) < 0
    goes_on = side.goes_on.copy()
    goes_on[goes_on] = kept
    return replace(side, goes_on=goes_on)


def _reached(side: FlatSide, free: np.ndarray) -> FlatSide:
    """The side, gone on over what is free (a, b) bool and hangs together with where it was measured, by no narrow strip."""
    from scipy.ndimage import binary_opening, label

    whole = binary_opening(np.pad(free | side.measured, SEAM), iterations=SEAM)[SEAM:-SEAM, SEAM:-SEAM]
    part = label(whole | side.measured)[0]
    free = free & whole
    return replace(side, goes_on=np.isin(part, np.unique(part[side.measured])) & free & ~side.measured)


def _by_direction(sides: Sequence[FlatSide]) -> list[list[FlatSide]]:
    """Sides that are parallel, together."""
    out: list[list[FlatSide]] = []
    for side in sides:
        for alike in out:
            if abs(side.normal @ alike[0].normal) > FACING:
                alike.append(side)
                break
        else:
            out.append([side])
    return out


def _seen_empty(thinned: Thinned, views: Views, xyz: np.ndarray) -> np.ndarray:
    """(k,) bool: places (k, 3) that lines of sight cross well before they end on what was measured, in `SEEN` views at least."""
    from massprops.geometry.projection import project

    count = np.zeros(len(xyz), np.int64)
    margin = 3 * thinned.spacing
    for i in range(len(views)):
        in_view = (thinned.views == i).any(1)
        if not in_view.any():
            continue
        pixels, depth = project(thinned.xyz[in_view], views.K[i], views.R[i], views.t[i])
        block = np.floor(pixels / BLOCK).astype(np.int64)
        low = block.min(0)
        ends = np.full(block.max(0) - low + 1, np.inf)
        np.minimum.at(ends, tuple((block - low).T), depth)
        pixels, depth = project(xyz, views.K[i], views.R[i], views.t[i])
        at = np.floor(pixels / BLOCK).astype(np.int64) - low
        inside = ((at >= 0) & (at < ends.shape)).all(1)
        end = ends[tuple(np.where(inside[:, None], at, 0).T)]
        count += inside & np.isfinite(end) & (depth < end - margin)
    return count >= SEEN
