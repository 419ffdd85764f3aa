"""The surface of a body of which the silhouettes alone are known: stereo measured next to nothing on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.geometry.projection import pixels_of
from massprops.geometry.vectors import unit
from massprops.surface.cloud import Cloud
from massprops.surface.level_set import level_set
from massprops.surface.reconstruct import ON_SUPPORT, Surface, on_support
from massprops.surface.refine import vertex_normals
from massprops.surface.silhouette import Hull, make_hull
from massprops.views import AMBIGUOUS, Views

WRONG = 0.25
"""Largest share of the views that may be wrong about a place without making it empty: of a body under one light, each part
is dark, and so like the sky, in some."""
UNCOVERED = 0.005
"""Share of the silhouettes that a hull may leave uncovered, over what the most cautious one leaves, before its views
contradict each other."""
WIDE = 1.4
"""Radius in which a body known by its outlines alone is looked for, in radii of the ball that holds what was lit of it."""
LEAST_VIEWS = 8
"""Silhouettes without which their hull is no body."""


def surface_of_outlines(
    views: Views,
    masks: list[np.ndarray],
    middle: np.ndarray,
    radius: float,
    progress: Progress = silent,
    support: np.ndarray | None = None,
) -> Surface:
    """The hull of the silhouettes as a surface of which nothing was measured.

    Args:
        views, masks, support: as for `reconstruct_surface`.
        middle: (3,) within the body; radius: of a ball about it that holds the body.
        progress: likewise.

    Raises:
        NotPossible: too few silhouettes, or no body common to them.
    """
    hull = hull_of_outlines(views, masks, middle, radius, support)
    progress(1, 3, "hull")
    body = body_of_hull(hull, middle, radius)
    progress(2, 3, "hull sampled")
    vertices, faces = level_set(body.value, body.origin, body.step)
    none = np.zeros(len(faces), bool)
    inferred = on_support(vertices, faces, support, ON_SUPPORT * body.step)
    cloud = outline_cloud(vertices, faces, views.centres, 0.2 * body.step)
    progress(3, 3, "surface of the hull")
    return Surface(vertices, faces, none, inferred, hull, cloud, body.step)


def hull_of_outlines(
    views: Views, masks: list[np.ndarray], middle: np.ndarray, radius: float, support: np.ndarray | None = None
) -> Hull:
    """The hull of the silhouettes, which may be open; arguments and error as those of `surface_of_outlines`.

    Raises:
        NotPossible: too few silhouettes.
    """
    seen = sum(bool((m == 255).any()) for m in masks)
    if seen < LEAST_VIEWS:
        raise NotPossible(
            f"next to nothing of the surface was measured, and {seen} silhouettes are too few for a shape from outlines "
            f"alone ({LEAST_VIEWS} are needed): give more images with more overlap (under 15 degrees between neighbours)"
        )
    views, masks = with_margins(views, masks)
    return consistent(make_hull(views, masks, middle[None], support=support), views, masks, middle, radius)


def with_margins(views: Views, masks: list[np.ndarray]) -> tuple[Views, list[np.ndarray]]:
    """Views and silhouettes with a margin round each image: sky where the silhouette keeps away from the image's edge,
    since then all of the body is in it, and no evidence where it does not."""
    wide = [int(MARGIN * max(m.shape)) for m in masks]
    K = views.K.copy()
    K[:, :2, 2] += np.array(wide)[:, None]
    out = []
    for mask, m in zip(masks, wide, strict=True):
        edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
        out.append(np.pad(mask, m, constant_values=0 if (edge == 0).all() and (mask == 255).any() else AMBIGUOUS))
    return replace(views, K=K, size=views.size + 2 * np.array(wide)[:, None]), out


MARGIN = 0.25
"""Width of the margin over the image's longer side: the ball that is searched reaches beyond the image."""
FACING = 3
"""Views that are taken to see a point of the hull."""
STEPS, FINER = 60, 3
"""Steps of the grid along the width of the space that is searched, and most parts of each near the hull."""
POINTS = 20_000
"""Points that stand for a hull's surface."""


def consistent(hull: Hull, views: Views, masks: list[np.ndarray], middle: np.ndarray, radius: float) -> Hull:
    """The hull with the fewest views that must agree on a place being empty for the silhouettes to stay covered.

    One view is enough where all are right (Laurentini 1994), and every further one leaves wedges of empty space between
    few views. A view that takes body for sky shows: silhouettes of other views are then not covered by the hull.

    Args:
        views, masks: of the hull; middle, radius: as for `surface_of_outlines`.
    """
    low, high = 1, max(3, round(WRONG * len(views)))
    bound = UNCOVERED + _uncovered(replace(hull, need=high), views, masks, middle, radius)
    while low < high:  # the more views must agree, the more is covered
        need = (low + high) // 2
        if _uncovered(replace(hull, need=need), views, masks, middle, radius) <= bound:
            high = need
        else:
            low = need + 1
    return replace(hull, need=high)


def _uncovered(hull: Hull, views: Views, masks: list[np.ndarray], middle: np.ndarray, radius: float) -> float:
    """Share of the silhouettes' pixels, mean over the views, that no part of the hull lies behind."""
    import cv2

    grid, step = grid_about(middle, radius, STEPS)
    inside = grid.reshape(-1, 3)[hull.value(grid.reshape(-1, 3)) < 0.5 * step / hull.pixel]
    share = []
    for i, mask in enumerate(masks):
        if not (mask == 255).any():
            continue
        _, rows, columns = pixels_of(inside, views.K[i], views.R[i], views.t[i], mask.shape)
        drawn = np.zeros(mask.shape, np.uint8)
        drawn[rows, columns] = 1
        wide = 2 * int(np.ceil(0.5 * np.sqrt(3.0) * step / hull.pixel)) + 1
        covered = cv2.dilate(drawn, np.ones((wide, wide), np.uint8)) > 0
        share.append(np.mean(~covered[mask == 255]))
    return float(np.mean(share))


def grid_about(middle: np.ndarray, radius: float, steps: int) -> tuple[np.ndarray, float]:
    """(steps, steps, steps, 3) points of a cube about the ball, and their distance."""
    flat = np.linspace(-radius, radius, steps)
    return middle + np.stack(np.meshgrid(flat, flat, flat, indexing="ij"), axis=-1), float(flat[1] - flat[0])


@dataclass(frozen=True)
class HullBody:
    """The hull on a regular grid of a `step` from `origin` (3,): its value (g, g, g) [px], negative within the body
    alone."""

    origin: np.ndarray
    value: np.ndarray
    step: float


def body_of_hull(hull: Hull, middle: np.ndarray, radius: float, within: float = np.inf) -> HullBody:
    """The largest piece of the hull.

    Args:
        hull: of the silhouettes.
        middle: (3,) within the body; radius: of a ball about it that holds the body.
        within: radius of a ball that closes the hull where no outline does; none by default.

    Raises:
        NotPossible: the silhouettes have no body in common there, or it reaches beyond the ball of `radius`.
    """
    from scipy.ndimage import label

    value, step = _value(hull, middle, radius)
    if np.isfinite(within):
        flat = np.linspace(-radius, radius, len(value)) ** 2
        away = np.sqrt(flat[:, None, None] + flat[:, None] + flat)
        value = np.maximum(value, (away - within) / hull.pixel)
    # thin parts may be parts of a step: pieces nearer than that are one
    piece, number = label(value < 0.5 * step / hull.pixel)
    if not (value < 0).any():
        raise NotPossible("surface: the silhouettes have no body in common; correct them and give them with --masks")
    body = piece == 1 + int(np.argmax(np.bincount(piece[value < 0], minlength=number + 1)[1:]))
    border = np.ones(body.shape, bool)
    border[1:-1, 1:-1, 1:-1] = False
    if body[border].mean() > 0.02:
        raise NotPossible("surface: the silhouettes do not bound a body; take images from more sides")
    return HullBody(middle - radius, np.where(body, value, np.maximum(np.abs(value), 1e-3)), step)


def _value(hull: Hull, middle: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
    """The hull's value on a fine grid (g, g, g), exact near the hull and that of a neighbour elsewhere, and the grid's
    step: a pixel, if that is not too many."""
    coarse, wide = grid_about(middle, radius, STEPS)
    value = hull.value(coarse.reshape(-1, 3)).reshape(coarse.shape[:3])
    finer = int(np.clip(np.ceil(wide / hull.pixel), 1, FINER))
    steps = finer * (STEPS - 1) + 1
    nearest = np.rint(np.arange(steps) / finer).astype(int)
    fine = value[np.ix_(nearest, nearest, nearest)]
    # no point is farther from its neighbour than half the diagonal, and distances in the image change no faster
    near = np.nonzero(np.abs(fine) < 1.5 * 0.5 * np.sqrt(3.0) * wide / hull.pixel)
    step = wide / finer
    fine[near] = hull.value(middle - radius + step * np.stack(near, axis=1))
    return fine, step


def outline_cloud(vertices: np.ndarray, faces: np.ndarray, centres: np.ndarray, sigma: float) -> Cloud:
    """Points of a hull's surface, facing outward, each with the views that look at it.

    Args:
        vertices: (v, 3); faces: (f, 3); centres: (n, 3) of the cameras; sigma: of the points.
    """
    some = slice(None, None, max(1, len(vertices) // POINTS))
    xyz, normal = vertices[some], vertex_normals(vertices, faces)[some]
    start = FACING * np.arange(len(xyz) + 1)
    return Cloud(xyz, normal, np.full(len(xyz), sigma), start, _facing(xyz, normal, centres).ravel()).finite()


def _facing(xyz: np.ndarray, normal: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(n, FACING) views that look most straight at each point."""
    out = np.empty((len(xyz), FACING), np.int64)
    for first in range(0, len(xyz), 8192):
        part = slice(first, first + 8192)
        sight = centres - xyz[part, None]
        along = np.einsum("nvi,ni->nv", sight, normal[part]) / np.linalg.norm(sight, axis=2)
        out[part] = np.argpartition(-along, FACING - 1, axis=1)[:, :FACING]
    return out


def ball_of_outlines(views: Views, masks: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Middle (3,) and radius of a ball that holds a body, from its silhouettes alone.

    The middle lies nearest, by least squares, to the rays through the middles of the silhouettes; the radius is the
    farthest pixel's distance from it in the views, but for the widest tenth of them.

    Args:
        masks: n undistorted silhouettes (h, w), 255 object.

    Raises:
        NotPossible: fewer than three silhouettes, or rays that do not meet before the cameras.
    """
    shown = [i for i, m in enumerate(masks) if (m == 255).any()]
    if len(shown) < 3:
        raise NotPossible(f"surface: {len(shown)} silhouettes are too few to say where the body is; give --masks")
    places = [np.argwhere(masks[i] == 255)[:, ::-1].astype(float) for i in shown]
    part = views.take(np.array(shown))
    ray = np.stack([np.linalg.solve(K, [*p.mean(0), 1.0]) for K, p in zip(part.K, places, strict=True)])
    ray = unit(np.einsum("nji,nj->ni", part.R, ray))
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    if np.linalg.cond(across.sum(0)) > 1e6:
        raise NotPossible("surface: the images look at the body from one side only, which bounds no body")
    middle = np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, part.centres))
    depth = np.einsum("nij,j->ni", part.R, middle) + part.t
    if np.mean(depth[:, 2] > 0) < 0.9:
        raise NotPossible("surface: the body lies behind the given cameras; are the poses world to camera?")
    reach = []
    for K, c, p in zip(part.K, depth, places, strict=True):
        pixel = (K @ c)[:2] / c[2]
        reach.append(float(np.linalg.norm(p - pixel, axis=1).max() / K[0, 0] * c[2]))
    return middle, float(np.quantile(reach, 0.9))
