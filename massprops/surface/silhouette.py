"""What the silhouettes say of a point in space: certainly empty, or perhaps inside.

The hull of Laurentini (1994) would let one wrong silhouette carve the body away, and an unlit side does look like
sky. Here a point is empty when at least `need` views see it outside the silhouette, and `need` is raised until the
measured points themselves, which are known to exist, are spared.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from massprops.geometry.projection import pixels_of
from massprops.geometry.vectors import unit
from massprops.surface.cloud import Cloud
from massprops.views import AMBIGUOUS, Views

Array = np.ndarray

STEP = 4.0
"""Distances to the outline are kept as int8 in quarters of a pixel."""


FEWEST_AGREE, MARGIN = 3, 2
"""How many instants must agree at least that a point is empty, and by how many more than contradict a measured point. The cameras of a pair
see the same shadow: a bus in paint (Blender), of which three views, two of them of one instant, called its shaded side sky, lost 10 % of
its volume to a pit in it."""


@dataclass(frozen=True)
class Hull:
    """Signed distances to every silhouette's outline.

    Attributes:
        maps: (n, h, w) int8, quarter pixels; positive in the sky, negative on what may be the object.
        size: (n, 2) int32 width and height of each view, maps are padded to the largest.
        P: (n, 3, 4) world to pixels.
        need: how many views must agree that a point is empty.
        pixel: typical size of a pixel at the object [world units].
        at_once: views of one instant.
        whole: (n,) bool, views that show all of the body: what lies beyond their images, or behind them, is as empty as their sky.
        support: (4,) unit normal and offset of the plane the object stands on, n.x + d = 0, the object on its
            positive side; None for a free body.
    """

    maps: np.ndarray
    size: np.ndarray
    P: np.ndarray
    need: int
    pixel: float
    at_once: int
    whole: np.ndarray
    support: np.ndarray | None = None

    @property
    def _evidence(self) -> tuple[Array, Array, Array, Array]:
        """What the compiled loops ask."""
        return self.maps, self.size, self.P, self.whole

    @property
    def outside_share(self) -> float:
        """Share of the views that show sky where the body was measured, of all but the worst hundredth of its points; 0
        where no more do than one silhouette in error explains."""
        margin = MARGIN * self.at_once
        return 0.0 if self.need <= FEWEST_AGREE * self.at_once else (self.need - margin) / len(self.maps)

    def value(self, xyz: np.ndarray) -> np.ndarray:
        """(m,) the `need`-th largest distance to an outline [px]: positive where the hull is not.

        What lies below the support is outside, by its depth in pixels: cameras above cannot see that it is empty.
        """
        value = _best(np.ascontiguousarray(xyz), *self._evidence, self.need)[:, -1]
        if self.support is None:
            return value
        return np.maximum(value, -(xyz @ self.support[:3] + self.support[3]) / self.pixel)

    def room(self, start: np.ndarray, direction: np.ndarray, reach: float) -> np.ndarray:
        """(e,) how far a body may go on from points of its surface before the silhouettes end [world units]; 0 where they do
        not end within reach, and so say nothing.

        Args:
            start: (e, 3); direction: (e, 3) unit, outward.
            reach: longest way that is looked at.
        """
        end, has_end = _exits(self, start - self.pixel * direction, direction, 0.25 * self.pixel, reach)
        return np.where(has_end, np.maximum(np.einsum("ei,ei->e", end - start, direction), 0.0), 0.0)

    def sparing(self, measured: np.ndarray, least: int = FEWEST_AGREE) -> Hull:
        """The same with the smallest `need`, at least `least` instants, that spares 99 % of the measured points (m, 3) by
        `MARGIN` instants."""
        sample = np.ascontiguousarray(measured[:: max(1, len(measured) // 4000)])
        false = _votes(sample, *self._evidence, 1.5)
        return replace(self, need=max(least * self.at_once, int(np.quantile(false, 0.99)) + MARGIN * self.at_once))


def make_hull(
    views: Views,
    masks: list[np.ndarray],
    measured: np.ndarray,
    least: int = 3,
    support: np.ndarray | None = None,
    free: bool = False,
) -> Hull:
    """Hull of undistorted silhouettes.

    Args:
        views: n cameras.
        masks: n arrays (h, w) uint8: 255 object, 0 sky, anything between is no evidence; none where no silhouette is
            known yet.
        measured: (m, 3) points known to be on the surface, which set `need`.
        least: fewest instants whose views may call a point empty.
        support: (4,) plane the object stands on, or None.
        free: the body is alone before the sky: an image whose edge is sky all round shows all of it. Of a CubeSat (Blender) of which 14
            views had to agree, the space beside and behind the cameras, which no 14 of them look at, was filled.
    """
    import cv2

    height, width = (max((m.shape[i] for m in masks), default=1) for i in (0, 1))
    maps = np.full((len(masks), height, width), -127, np.int8)
    for i, mask in enumerate(masks):
        sky = (mask == 0).astype(np.uint8)
        if not sky.any() or not (mask == 255).any():
            continue
        out = cv2.distanceTransform(sky, cv2.DIST_L2, 5)
        inside = cv2.distanceTransform(1 - sky, cv2.DIST_L2, 5)
        maps[i, : mask.shape[0], : mask.shape[1]] = np.clip(np.rint(STEP * (out - inside)), -127, 127)
    size = np.array([m.shape[::-1] for m in masks], np.int32).reshape(-1, 2)
    P = np.einsum("nij,njk->nik", views.K, np.concatenate([views.R, views.t[:, :, None]], axis=2))[: len(masks)]
    depth = np.einsum("ni,ni->n", views.R[:, 2], measured.mean(0)[None].repeat(len(views), 0)) + views.t[:, 2]
    pixel = float(np.median(depth / views.K[:, 0, 0]))
    whole = np.array([free and _all_round(m == 0) and bool((m == 255).any()) for m in masks], np.bool_)
    hull = Hull(maps, size, P, least, pixel, at_once=_at_once(views), whole=whole, support=support)
    return hull.sparing(measured, least)


def _all_round(sky: np.ndarray) -> bool:
    """Whether the edge of an image (h, w) bool is sky."""
    return bool(sky[0].all() and sky[-1].all() and sky[:, 0].all() and sky[:, -1].all())


def _at_once(views: Views) -> int:
    """How many views show one instant, mostly; 1 where there is no clock."""
    time = views.timestamp_ns
    if not len(time) or time.min() < 0:
        return 1
    return int(np.median(np.unique(time, return_counts=True)[1]))


INSIDE = 2.0
"""Depth within a silhouette [px] from which on a pixel shows the object, whatever the outline's own error."""


def shown_as_object(cloud: Cloud, views: Views, masks: list[np.ndarray]) -> np.ndarray:
    """(n,) bool: points that lie within the silhouette in most of the views they were measured in.

    A gloss shows the room mirrored, at a place behind the surface, and a flat part lies nearer to its table than the
    table's own points scatter: neither is a point of the surroundings.

    Args:
        cloud: its views index `views`.
        views, masks: as for `make_hull`.
    """
    import cv2

    maps = (
        (cv2.distanceTransform((mask != 0).astype(np.uint8), cv2.DIST_L2, 5) > INSIDE).astype(np.float64)
        if (mask == 255).any()
        else None
        for mask in masks
    )
    return mean_shown(cloud, views, maps) > 0.5


def mean_shown(cloud: Cloud, views: Views, maps: Iterable[np.ndarray | None]) -> np.ndarray:
    """(n,) mean of the views' maps at points over the views that they were measured in, 0 where none shows them.

    Args:
        cloud: its views index `views`; maps: (h, w) of each view, or None of one that says nothing.
    """
    total, number_of_views = np.zeros(len(cloud)), np.zeros(len(cloud))
    owner = np.repeat(np.arange(len(cloud)), np.diff(cloud.view_start))
    for i, shown in enumerate(maps):
        if shown is None:
            continue
        in_view = owner[cloud.view_index == i]
        there, rows, columns = pixels_of(cloud.xyz[in_view], views.K[i], views.R[i], views.t[i], shown.shape)
        number_of_views[in_view[there]] += 1
        total[in_view[there]] += shown[rows, columns]
    return np.asarray(total / np.maximum(number_of_views, 1))


def agreement(vertices: np.ndarray, faces: np.ndarray, views: Views, masks: list[np.ndarray]) -> np.ndarray:
    """(n,) intersection over union of a mesh's silhouette and each view's own; NaN where the view has none.

    Args:
        vertices: (v, 3) and faces: (f, 3) of the mesh.
        views, masks: as for `make_hull`; pixels of no evidence do not count.
    """
    from massprops.geometry.rasterise import silhouette

    out = np.full(len(masks), np.nan)
    for i, mask in enumerate(masks):
        if (mask == 255).any():
            out[i] = overlap(silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], mask.shape[::-1]), mask)
    return out


def overlap(drawn: np.ndarray, mask: np.ndarray) -> float:
    """Intersection over union of a drawn body (h, w) bool and a silhouette, NaN where that is empty; see `agreement`."""
    inside, known = mask == 255, (mask == 0) | (mask == 255)
    return np.count_nonzero(inside & drawn) / np.count_nonzero((inside | drawn) & known) if inside.any() else np.nan


def lit_overlap(drawn: np.ndarray, mask: np.ndarray, measured: np.ndarray) -> float:
    """As `overlap`, of a body in sunlight before the sky, whose silhouette ends where its light does.

    The unlit side of a body looks like sky, so sky is no evidence where the body was measured: what stereo saw lit in other
    images is there. Nor are the silhouette's outermost pixels, which the body fills in part: a thin rod has no others. Parts that
    were not measured, and all that the silhouette shows besides, count as before.

    Args:
        measured: (h, w) bool, the drawn body shows a side there that stereo measured.
    """
    import cv2

    inner = cv2.erode((mask == 255).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rim = (mask == 255) & ~inner & ~drawn
    return overlap(drawn, np.where(rim | ((mask == 0) & measured), np.uint8(AMBIGUOUS), mask))


_View = tuple[np.ndarray, int, int, tuple[float, ...], bool]
"""Map, width, height and projection matrix, row by row, of a view, and whether it shows all of the body."""
FARTHEST = 127 / STEP
"""Greatest distance to an outline that a map keeps [px]."""


@njit(cache=True, inline="always", error_model="numpy")
def _view(maps: Array, size: Array, P: Array, whole: Array, v: int) -> _View:
    """Map, size and matrix of view v as values: read once and not for every point."""
    p = (P[v, 0, 0], P[v, 0, 1], P[v, 0, 2], P[v, 0, 3], P[v, 1, 0], P[v, 1, 1], P[v, 1, 2], P[v, 1, 3],
         P[v, 2, 0], P[v, 2, 1], P[v, 2, 2], P[v, 2, 3])  # fmt: skip
    return maps[v], size[v, 0], size[v, 1], p, whole[v]


@njit(cache=True, error_model="numpy")
def _distance(view: _View, x: float, y: float, z: float) -> float:
    """Distance to the outline in a view [px]; where the point is not in the image, nan, or the farthest where it shows all of the body."""
    m, width, height, p, whole = view
    beyond = FARTHEST if whole else np.nan
    d = p[8] * x + p[9] * y + p[10] * z + p[11]
    if d <= 1e-9:
        return beyond
    a = (p[0] * x + p[1] * y + p[2] * z + p[3]) / d
    b = (p[4] * x + p[5] * y + p[6] * z + p[7]) / d
    if not (a >= 0 and b >= 0 and a < width - 1 and b < height - 1):
        return beyond
    i, j = int(b), int(a)
    fb, fa = b - i, a - j
    top = m[i, j] * (1 - fa) + m[i, j + 1] * fa
    low = m[i + 1, j] * (1 - fa) + m[i + 1, j + 1] * fa
    out: float = (top * (1 - fb) + low * fb) / 4.0
    return out


@njit(cache=True, error_model="numpy")
def _votes(xyz: Array, maps: Array, size: Array, P: Array, whole: Array, margin: float) -> Array:
    out = np.zeros(len(xyz), np.int64)
    for v in range(len(P)):
        view = _view(maps, size, P, whole, v)
        for i in range(len(xyz)):
            if _distance(view, xyz[i, 0], xyz[i, 1], xyz[i, 2]) > margin:
                out[i] += 1
    return out


@njit(cache=True, error_model="numpy")
def _best(xyz: Array, maps: Array, size: Array, P: Array, whole: Array, need: int) -> Array:
    """(n, need) the greatest distances of each point, descending."""
    out = np.full((len(xyz), need), -32.0)
    for v in range(len(P)):
        view = _view(maps, size, P, whole, v)
        for i in range(len(xyz)):
            d = _distance(view, xyz[i, 0], xyz[i, 1], xyz[i, 2])
            if d > out[i, need - 1]:
                k = need - 1
                while k > 0 and out[i, k - 1] < d:
                    out[i, k] = out[i, k - 1]
                    k -= 1
                out[i, k] = d
    return out


@njit(cache=True, error_model="numpy")
def _is_sky(maps: Array, size: Array, P: Array, whole: Array, need: int, x: float, y: float, z: float) -> bool:
    """Whether `need` views see a point outside their outlines."""
    for v in range(len(P)):
        if _distance(_view(maps, size, P, whole, v), x, y, z) > 0:
            need -= 1
            if need == 0:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _first_exit(
    start: Array,
    direction: Array,
    first: float,
    reach: float,
    maps: Array,
    size: Array,
    P: Array,
    whole: Array,
    need: int,
) -> tuple[Array, Array]:
    out = np.empty_like(start)
    hit = np.zeros(len(start), np.bool_)
    for i in range(len(start)):
        px, py, pz = start[i, 0], start[i, 1], start[i, 2]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        low, step, t = 0.0, first, first
        sky_reached = False
        while t < reach:
            if _is_sky(maps, size, P, whole, need, px + t * dx, py + t * dy, pz + t * dz):
                sky_reached = True
                break
            low = t
            step *= 1.25
            t += step
        if not sky_reached:
            continue
        high = t
        for _ in range(12):
            middle = 0.5 * (low + high)
            if _is_sky(maps, size, P, whole, need, px + middle * dx, py + middle * dy, pz + middle * dz):
                high = middle
            else:
                low = middle
        t = 0.5 * (low + high)
        out[i, 0], out[i, 1], out[i, 2] = px + t * dx, py + t * dy, pz + t * dz
        hit[i] = True
    return out, hit


def hull_points(
    hull: Hull, start: np.ndarray, normal: np.ndarray, spacing: float, reach: float, rays: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays from just below the measured surface leave the hull: its unseen side, found at any thinness.

    Args:
        start, normal: (m, 3) measured points.
        spacing: first step of the search.
        reach: longest ray.
        rays: directions tried for each point, one of them straight inward.
        seed: of the directions.

    Returns:
        points on the hull (k, 3), and where their rays began (k, 3).
    """
    rng = np.random.default_rng([seed, 12])
    begin = np.repeat(start - 0.2 * spacing * normal, rays, axis=0)
    direction = unit(rng.standard_normal((len(begin), 3)))
    outward = np.repeat(normal, rays, axis=0)
    along = np.einsum("ij,ij->i", direction, outward)
    direction -= np.where(along > 0.25, 2 * along, 0.0)[:, None] * outward
    direction[::rays] = -normal
    exits, hit = _exits(hull, begin, direction, 0.3 * spacing, reach)
    begin = begin[hit]
    return _above_support(hull, begin, exits[hit]), begin


def exit_points(
    hull: Hull, start: np.ndarray, direction: np.ndarray, first: float, reach: float, missed: bool = False
) -> np.ndarray:
    """Where rays leave the hull (k, 3); those that do not within their reach are left out, or end there where `missed`.

    Args:
        start, direction: (m, 3), unit directions; first: step of the search; reach: longest ray.
    """
    exits, hit = _exits(hull, start, direction, first, reach)
    if not missed:
        return _above_support(hull, start[hit], exits[hit])
    return _above_support(hull, start, np.where(hit[:, None], exits, start + reach * direction))


def _exits(
    hull: Hull, start: np.ndarray, direction: np.ndarray, first: float, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays (m, 3) leave the hull, and (m,) bool whether they do within their reach."""
    start, direction = np.ascontiguousarray(start), np.ascontiguousarray(direction)
    return _first_exit(start, direction, first, reach, *hull._evidence, hull.need)


def _above_support(hull: Hull, begin: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Ends (k, 3) of rays, on the support where they went through it."""
    if hull.support is None:
        return found
    above, below = (x @ hull.support[:3] + hull.support[3] for x in (begin, found))
    through = (above > 0) & (below < 0)
    share = above[through] / (above[through] - below[through])
    out = found.copy()
    out[through] = begin[through] + share[:, None] * (found[through] - begin[through])
    return out
