"""Space that silhouettes alone show: inside the visual hull, and where the cut left nothing.

A ray through a silhouette meets matter somewhere (Laurentini 1994 the other way round). The cut pays for surface, and a
thin bar that nothing was measured on has more surface than its volume is worth. So after a cut the silhouettes are compared
with those of its mesh: where a ray meets nothing, the hull's space on the ray is what it may have met. Cells of that space
are rewarded for being inside, each ray with the weight of one line of sight to a measured point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.geometry.pixels import box_about, grown
from massprops.geometry.projection import pixels_of
from massprops.geometry.rasterise import silhouette
from massprops.geometry.vectors import unit
from massprops.surface.silhouette import FEWEST_AGREE, Hull, exit_points
from massprops.views import AMBIGUOUS, Views

EDGE = 2.0
"""Depth within a silhouette, and distance from what was drawn [px], from which on a ray that meets nothing is no error of
an outline."""
SHARP_EDGE = 0.9
"""That depth where outlines are known to a pixel, as of a body lit before black sky: a bar of three pixels has a middle so deep."""
PROTRUDES = 0.05
"""Distance from the mesh, over the body's extent, from which on a place on such rays is of a part that was lost. What is nearer is left to
the fill, which a free body's centre of mass tells. A lost boom made a body in foil .22 shorter; nearer places taken for parts made a
spacecraft 4.2 % too large, which was 1.5 % too small."""
LEAST_RAYS = 30
"""Rays of all views without which nothing is missing."""
RAY_WEIGHT = 2.0
"""What the rays of all views through one place weigh together, as the lines of sight of one measured point do. Chosen while
looking at a padlock; a jug's lid and a chair's slats came right with it."""
TELLING = 1 / 3
"""Least share of the views that a place's rays are counted of. Of a boom before a body in foil 22 of 86 views tell, all for it: by its share of
all views it was lost."""
CHORDS = 4
"""Views along whose rays the thickness of the space is measured."""
DIRECTIONS = 6
"""Rays from each place in the space to its outside."""
MOST = 6000
"""Places of the space that are kept."""
LIT_VIEWS, LIT_OVER_SKY = 0.2, 1.5
"""Share of the views in which a silhouette shows a part that the mesh misses, and over those in which sky is there: places on the boom of a body in
foil lie on its silhouette in 30 to 61 of 85 views and on sky in 0 to 33, places off it in up to 17 of either."""
LIT_SPACING, LIT_SAMPLE = 2, 4
"""Distance between places that are looked at, in spacings of the mesh, and of which views a sample is asked first."""
DARK_PIXELS = 3
"""Distance from a silhouette from which on a part is not lit, and about which sky is no evidence [px]."""
MOST_LOOKED_AT = 4_000_000
"""Places along rays that are looked at, about: 100 bytes and some microseconds each."""


@dataclass(frozen=True)
class SilhouetteOnly:
    """Rays that meet nothing.

    Attributes:
        views: n views; maps: n (h, w) bool, pixels of the silhouettes on which nothing was drawn; sky: n (h, w) bool, pixels
            outside the silhouettes.
        inside: (k, 3) places of the hull on such rays, of three views or more; outline: (m, 3) places on its outside.
    """

    views: Views
    maps: list[np.ndarray]
    sky: list[np.ndarray]
    inside: np.ndarray
    outline: np.ndarray

    def share(self, xyz: np.ndarray) -> np.ndarray:
        """(m,) share of the views that tell of each point (m, 3) in which it lies on a ray that meets nothing; 0 where as many show it as sky.

        A ray that meets the mesh tells nothing: the point may lie before it or behind.
        """
        shown, sky = _views_for_and_sky(self.views, self.maps, self.sky, xyz)
        return shown / np.maximum(shown + sky, TELLING * len(self.maps))


def silhouette_only_space(
    mesh: tuple[np.ndarray, np.ndarray],
    views: Views,
    masks: list[np.ndarray],
    hull: Hull,
    spacing: float,
    seed: int,
    sharp: bool = False,
) -> SilhouetteOnly | None:
    """What the silhouettes show beside a mesh; None where there is nothing.

    Args:
        mesh: its vertices (v, 3) and faces (f, 3); views, masks: as for `make_hull`; hull: of these.
        spacing: of the mesh's vertices; seed: of the draws.
        sharp: silhouettes are known to a pixel (lit before black sky, or given), and only parts that protrude are looked for, and holes in
            the mesh: stereo measures nothing on the plain paint of a wing, and where its back was never lit a cut leaves nothing there.
    """
    edge, reach = SHARP_EDGE if sharp else EDGE, _extent(mesh)
    maps, places = _rays_that_meet_nothing(mesh, views, masks, hull, spacing, edge)
    sky = [mask == 0 for mask in masks]
    xyz = np.concatenate([np.zeros((0, 3)), *(x[hull.value(x) < 0] for x in places if len(x))])
    if len(xyz) < LEAST_RAYS:
        return None
    xyz = xyz[np.unique(np.floor(xyz / spacing).astype(np.int64), axis=0, return_index=True)[1]]
    xyz, shown = _agreed(views, maps, sky, xyz)
    if sharp and len(xyz) >= LEAST_RAYS and not _protrudes(xyz, mesh[0], PROTRUDES * reach):
        maps = _in_holes(mesh, views, maps)
        xyz, shown = _agreed(views, maps, sky, xyz)
    if len(xyz) < LEAST_RAYS:
        return None
    rng = np.random.default_rng([seed, 14])
    xyz = xyz[_sample(shown, rng)]
    direction = unit(rng.standard_normal((len(xyz) * DIRECTIONS, 3)))
    begin = np.repeat(xyz, DIRECTIONS, axis=0)
    outline = exit_points(hull, begin, direction, 0.3 * spacing, reach)
    outline = outline[_views_showing(views, maps, outline) > 0]
    if not len(outline):
        return None
    return SilhouetteOnly(views, maps, sky, xyz, outline)


def _agreed(
    views: Views, maps: list[np.ndarray], sky: list[np.ndarray], xyz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The places (k, 3) that enough views show and fewer show as sky, and how many views show each (k,)."""
    shown = _views_for(views, maps, sky, xyz)
    return xyz[shown >= FEWEST_AGREE], shown[shown >= FEWEST_AGREE]


def _in_holes(mesh: tuple[np.ndarray, np.ndarray], views: Views, maps: list[np.ndarray]) -> list[np.ndarray]:
    """Of the pixels (h, w) bool on which nothing was drawn those that have the mesh all about them."""
    import cv2

    out = [np.zeros_like(m) for m in maps]
    for i, m in enumerate(maps):
        if m.any():
            drawn = silhouette(*mesh, views.K[i], views.R[i], views.t[i], m.shape[::-1])
            empty = np.pad((~drawn).astype(np.uint8), 1, constant_values=1)  # the image's border belongs to the sky
            label = cv2.connectedComponents(empty, connectivity=4)[1]
            out[i] = m & (label[1:-1, 1:-1] != label[0, 0])
    return out


def _sample(shown: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Numbers of at most `MOST` places, of which so many views (k,) show each.

    With a chance as the square of that (Efraimidis and Spirakis 2006): a boom that most views show has little volume beside a corner that a
    few leave open, and without places in it no cut can keep it.
    """
    if len(shown) <= MOST:
        return np.arange(len(shown))
    return np.sort(np.argsort(np.log(rng.random(len(shown))) / shown.astype(float) ** 2)[-MOST:])


def lit_at_times(
    mesh: tuple[np.ndarray, np.ndarray], views: Views, masks: list[np.ndarray], hull: Hull, spacing: float
) -> np.ndarray:
    """(k, 3) places of parts of a turning body before a black sky that a mesh misses though silhouettes show them, sky in other images or not:
    there they were not lit.

    A place off the part lies on its silhouette in a few views, and on sky in most.

    Args:
        as of `silhouette_only_space`.
    """
    from scipy.spatial import cKDTree

    maps, places = _rays_that_meet_nothing(mesh, views, masks, hull, LIT_SPACING * spacing, SHARP_EDGE)
    xyz = np.concatenate([np.zeros((0, 3)), *places])
    some = np.arange(0, len(masks), LIT_SAMPLE)
    xyz = xyz[_views_showing(views.take(some), [maps[i] for i in some], xyz) >= 0.5 * LIT_VIEWS * len(some)]
    shown = _views_showing(views, maps, xyz)
    often = shown >= LIT_VIEWS * len(masks)
    xyz, shown = xyz[often], shown[often]
    xyz = xyz[shown > LIT_OVER_SKY * _views_showing(views, [mask == 0 for mask in masks], xyz)]
    away, reach = cKDTree(mesh[0]).query(xyz)[0], PROTRUDES * _extent(mesh)
    if np.count_nonzero(away > reach) < LEAST_RAYS:
        return xyz[:0]
    # rims of the body are shown, too
    root = cKDTree(xyz[away > reach]).query(xyz)[0] < reach
    return xyz[root & (away > EDGE * hull.pixel)]


def spare_where_dark(views: Views, masks: list[np.ndarray], xyz: np.ndarray) -> list[np.ndarray]:
    """Silhouettes (h, w) in which sky about places (k, 3) that were not lit is 128, no evidence."""
    import cv2

    out = []
    for i, mask in enumerate(masks):
        _, rows, columns = pixels_of(xyz, views.K[i], views.R[i], views.t[i], mask.shape)
        away = cv2.distanceTransform((mask != 255).astype(np.uint8), cv2.DIST_L2, 5)
        dark = away[rows, columns] > DARK_PIXELS
        at = np.zeros(mask.shape, bool)
        at[rows[dark], columns[dark]] = True
        out.append(np.where(grown(at, DARK_PIXELS) & (mask == 0), np.uint8(AMBIGUOUS), mask))
    return out


def _extent(mesh: tuple[np.ndarray, np.ndarray]) -> float:
    return float(np.linalg.norm(np.ptp(mesh[0], axis=0)))


def _rays_that_meet_nothing(
    mesh: tuple[np.ndarray, np.ndarray],
    views: Views,
    masks: list[np.ndarray],
    hull: Hull,
    spacing: float,
    edge: float,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pixels (h, w) bool of each silhouette on which nothing was drawn, and the places (k, 3) along the rays of some of them.

    Args:
        edge: depth within a silhouette from which on pixels count [px]; the others as of `silhouette_only_space`.
    """
    vertices = mesh[0]
    maps = missed(mesh, views, masks, edge)
    low, high, reach = vertices.min(0), vertices.max(0), _extent(mesh)
    step = max(1, round(2 * spacing / hull.pixel))
    every = sum(int(np.count_nonzero(m)) for m in maps) * 2 * reach / spacing
    # where images were placed wrongly a mesh misses most of every silhouette
    step = max(step, int(np.ceil(np.sqrt(every / MOST_LOOKED_AT))))
    return maps, [_along(views, i, m, step, 0.5 * (low + high), reach, spacing) for i, m in enumerate(maps)]


def missed(
    mesh: tuple[np.ndarray, np.ndarray], views: Views, masks: list[np.ndarray], edge: float = SHARP_EDGE
) -> list[np.ndarray]:
    """Pixels (h, w) bool of each silhouette on which a mesh draws nothing; edge: depth within it from which on pixels count [px]."""
    return [
        _missing(mask, edge, silhouette(*mesh, views.K[i], views.R[i], views.t[i], mask.shape[::-1]))
        for i, mask in enumerate(masks)
    ]


def inside_reward(
    found: SilhouetteOnly, hull: Hull, middle: np.ndarray, volume: np.ndarray, spacing: float
) -> np.ndarray:
    """(t,) reward of cells for being labelled inside, from the rays that meet nothing else.

    Args:
        middle: (t, 3) and volume: (t,) of the cells; spacing: of rays.
    """
    out = np.zeros(len(middle))
    share = found.share(middle)
    some = np.flatnonzero(share > 0)
    if len(some):
        chord = np.maximum(_thickness(found, hull, middle[some], spacing), spacing)
        out[some] = RAY_WEIGHT * share[some] * volume[some] / (spacing**2 * chord)
    return out


def _protrudes(xyz: np.ndarray, vertices: np.ndarray, far: float) -> bool:
    """Whether enough of some places (k, 3) lie that far from every vertex (v, 3)."""
    from scipy.spatial import cKDTree

    return bool(np.count_nonzero(cKDTree(vertices).query(xyz, distance_upper_bound=2 * far)[0] > far) >= LEAST_RAYS)


def _missing(mask: np.ndarray, edge: float, drawn: np.ndarray) -> np.ndarray:
    """(h, w) bool: well within a silhouette and well off what was drawn."""
    import cv2

    out = np.zeros(mask.shape, bool)
    body = (mask == 255).astype(np.uint8)
    if not body.any():
        return out
    about = box_about(body)
    deep = cv2.distanceTransform(body[about], cv2.DIST_L2, 5) > edge
    if (deep & ~drawn[about]).any():
        apart = cv2.distanceTransform((~drawn).astype(np.uint8), cv2.DIST_L2, 5) > EDGE
        out[about] = deep & apart[about]
    return out


def _along(
    views: Views, i: int, missing: np.ndarray, step: int, middle: np.ndarray, extent: float, spacing: float
) -> np.ndarray:
    """(k, 3) places along the rays of some pixels of view i, as deep as the object may reach."""
    v, u = np.nonzero(missing)
    kept = (v % step == 0) & (u % step == 0)
    pixel = np.column_stack([u[kept], v[kept], np.ones(int(kept.sum()))])
    ray = pixel @ np.linalg.inv(views.K[i]).T
    depth = float(views.R[i, 2] @ middle + views.t[i, 2])
    deep = np.arange(max(depth - extent, 0.05 * depth), depth + extent, spacing)
    camera = (ray[:, None] * deep[:, None]).reshape(-1, 3)
    return np.asarray((camera - views.t[i]) @ views.R[i])


def _views_for(views: Views, maps: list[np.ndarray], sky: list[np.ndarray], xyz: np.ndarray) -> np.ndarray:
    """(m,) in how many views each point (m, 3) falls on a pixel of the maps; 0 where it falls on sky in as many.

    A hull that must spare points in many views, or a place that few images have in their frame, is not told to be empty by
    that many: rods that end at the frame's edge made a horn of it, twice as long as the body.
    """
    return _views_for_and_sky(views, maps, sky, xyz)[0]


def _views_for_and_sky(
    views: Views, maps: list[np.ndarray], sky: list[np.ndarray], xyz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(m,) as `_views_for`, and (m,) in how many views each point that any shows falls on sky."""
    shown, on_sky = _views_showing(views, maps, xyz), np.zeros(len(xyz), int)
    some = np.flatnonzero(shown)
    on_sky[some] = _views_showing(views, sky, xyz[some])
    return np.where(on_sky >= shown, 0, shown), on_sky


def _views_showing(views: Views, maps: list[np.ndarray], xyz: np.ndarray) -> np.ndarray:
    """(m,) in how many views each point (m, 3) falls on a pixel of the maps."""
    out = np.zeros(len(xyz), int)
    for i, m in enumerate(maps):
        if not m.any():
            continue
        there, rows, columns = pixels_of(xyz, views.K[i], views.R[i], views.t[i], m.shape)
        out[there] += m[rows, columns]
    return out


def _thickness(found: SilhouetteOnly, hull: Hull, xyz: np.ndarray, spacing: float) -> np.ndarray:
    """(m,) length of the hull about each point along rays of a few views, in the median."""
    chosen = np.unique(np.linspace(0, len(found.views) - 1, CHORDS).astype(int))
    reach, lengths = 40.0 * spacing, []
    for i in chosen:
        ray = unit(xyz - found.views.centres[i])
        ends = [
            np.linalg.norm(exit_points(hull, xyz, s * ray, 0.3 * spacing, reach, missed=True) - xyz, axis=1)
            for s in (1, -1)
        ]
        lengths.append(ends[0] + ends[1])
    return np.asarray(np.median(lengths, axis=0))
