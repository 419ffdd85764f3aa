"""The surface of a body of which the silhouettes alone are known: stereo measured next to nothing on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.surface.cloud import Cloud
from massprops.surface.reconstruct import Surface, on_support, reconstruct_surface
from massprops.surface.silhouette import Hull, make_hull
from massprops.views import Views

WRONG = 0.06
"""Share of the views that may be wrong about a place without making it empty."""
LEAST_VIEWS = 8
"""Silhouettes without which their hull is no body."""


def surface_of_outlines(
    views: Views,
    masks: list[np.ndarray],
    middle: np.ndarray,
    radius: float,
    seed: int = 0,
    progress: Progress = silent,
    support: np.ndarray | None = None,
) -> Surface:
    """The hull of the silhouettes as a surface of which nothing was measured.

    Args:
        views, masks, support: as for `reconstruct_surface`.
        middle: (3,) within the body; radius: of a ball about it that holds the body.
        seed, progress: likewise.

    Raises:
        NotPossible: too few silhouettes, or no body common to them.
    """
    if sum(bool((m == 255).any()) for m in masks) < LEAST_VIEWS:
        raise NotPossible(f"surface: fewer than {LEAST_VIEWS} silhouettes, too few for a shape from outlines alone")
    hull = make_hull(views, masks, middle[None], support=support)
    hull = replace(hull, need=max(3, round(WRONG * len(views))))
    surface = reconstruct_surface(
        views,
        masks,
        outline_cloud(hull, views.centres, middle, radius),
        seed=seed,
        progress=progress,
        support=support,
        moving=False,
    )
    none = np.zeros(len(surface.faces), bool)
    inferred = on_support(surface.vertices, surface.faces, support, 0.75 * surface.spacing)
    return replace(surface, observed=none, inferred=inferred)


FACING = 3
"""Views that are taken to see a point of the hull."""
STEPS = 90
"""Steps of the grid along the width of the space that is searched."""


def outline_cloud(hull: Hull, centres: np.ndarray, middle: np.ndarray, radius: float) -> Cloud:
    """Where the edges of a grid cross the hull, facing outward, each with the views that look at it.

    Args:
        hull: of the silhouettes; centres: (n, 3) of the cameras.
        middle: (3,) within the body; radius: of a ball about it that holds the body.

    Raises:
        NotPossible: the silhouettes have no body in common there, or it reaches beyond the ball.
    """
    from scipy.ndimage import label

    flat = np.linspace(-radius, radius, STEPS)
    step = float(flat[1] - flat[0])
    grid = middle + np.stack(np.meshgrid(flat, flat, flat, indexing="ij"), axis=-1)
    value = hull.value(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    piece, number = label(value < 0)
    if number == 0:
        raise NotPossible("surface: the silhouettes have no body in common; mend them and give them with --masks")
    body = piece == 1 + int(np.argmax(np.bincount(piece.ravel())[1:]))
    border = np.ones(body.shape, bool)
    border[1:-1, 1:-1, 1:-1] = False
    if body[border].mean() > 0.02:
        raise NotPossible("surface: the silhouettes do not bound a body; take images from more sides")
    # other pieces are no body: they must not be crossed
    value = np.where(body, value, np.maximum(np.abs(value), 1e-3))
    slope = np.stack(np.gradient(value), axis=-1)
    points, normals = [], []
    for axis in range(3):
        here, there = (
            tuple(slice(a, b) if k == axis else slice(None) for k in range(3)) for a, b in ((None, -1), (1, None))
        )
        crossed = body[here] != body[there]
        a, b = value[here][crossed], value[there][crossed]
        share = (a / (a - b))[:, None]
        points.append(grid[here][crossed] + share * (grid[there][crossed] - grid[here][crossed]))
        normals.append((1 - share) * slope[here][crossed] + share * slope[there][crossed])
    xyz, normal = np.concatenate(points), np.concatenate(normals)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    start = FACING * np.arange(len(xyz) + 1)
    return Cloud(xyz, normal, np.full(len(xyz), 0.2 * step), start, _facing(xyz, normal, centres).ravel()).finite()


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
    ray = np.einsum("nji,nj->ni", part.R, ray)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
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
