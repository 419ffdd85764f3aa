"""Moves the thin parts of a still object to where its edges are in the images.

Legs, blades and plates are narrower than a window of stereo: whatever it matches there is half background, and no window fits on them
to be compared once more (`photometric`). Their edges are sharp in the images all the same. Along the outline of the mesh in every
image the place is looked for where the grey changes most. A pattern behind or on the object changes, too, but elsewhere in every image,
so the surface goes to the middle of what many images say of a place, as far as halves of them agree on that.

Where the support lies close behind an outline, the object's own shade has an edge there. That is not asked.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprops.geometry.interpolation import peak
from massprops.geometry.rasterise import rasterise
from massprops.surface.fill_bounds import thickness
from massprops.surface.moved import Mesh, in_common, moved, spread_out
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import face_normals, vertex_normals
from massprops.views import Views

FARTHEST, STEP = 4.0, 0.5
"""How far from the mesh's outline an edge is looked for, and in which steps [px]."""
SLOPE = 1.0
"""On either side of a place, over which the grey's change is taken [px]."""
LEAST_CHANGE = 10.0
"""Grey levels by which the grey must change over that, to be an edge: noise of photographs is 1 to 4 levels."""
THIN = 12.0
"""How thick a part is at most [px] to be moved: a window of dense stereo is 9 to 13 px wide, so that what is thicker is measured."""
CLEAR = 16.0
"""How far the support must lie behind an outline [px]: nearer to it lies the shade at a foot."""
APART = 3.0
"""Between vertices that are asked about [px]."""
NEAR, MOST_NEAR, LEAST_NEAR = 6.0, 30, 8
"""Edges of half of the images within this distance [px] say where the surface is, so many of them at most, and at least; as far again
in the normal, where it turns by a radian: the two sides of a blade are different places."""
COMMON = 24.0
"""1-sigma of the surface over which halves of the images are compared [px], wide as in `photometric`."""
BLUR = 1.0
"""1-sigma by which the drawn mesh is blurred, to tell which way its outline runs and where between pixels it lies [px]."""


class _Edges(NamedTuple):
    """Faces (k,) int on outlines of the mesh, how far outside it the images' edges lie there (k,) [world units], and the view (k,) int."""

    face: np.ndarray
    gap: np.ndarray
    view: np.ndarray


def moved_to_edges(surface: Surface, views: Views, grey: list[np.ndarray], masks: list[np.ndarray]) -> Surface:
    """The surface with its cloud, thin parts moved to their edges in the images, as `moved` does that.

    Args:
        views: n cameras; grey: n undistorted images (h, w); masks: n undistorted silhouettes (h, w), 255 object, 0 sky.
    """
    support, pixel = surface.hull.support, surface.hull.pixel

    def ask(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
        return offsets(mesh, views, grey, support, pixel)

    return moved(surface, ask, views, masks)


def offsets(
    mesh: Mesh, views: Views, grey: list[np.ndarray], support: np.ndarray | None, pixel: float
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (k,) int of thin parts, and how far outward the surface should move there (k,) [world units].

    Args:
        views: n cameras; grey: n undistorted images (h, w).
        support: (4,) plane the object stands on, or None; pixel: of an image at the object [world units].
    """
    from scipy.spatial import cKDTree

    none = np.zeros(0, int), np.zeros(0)
    thin = np.zeros(len(mesh[1]), bool)
    thin[thickness(mesh, np.arange(len(mesh[1]))) < THIN * pixel] = True
    edges = _edges(mesh, thin, views, grey, support, pixel)
    vertices, normal = mesh[0], vertex_normals(*mesh)
    own = np.unique(mesh[1][thin])
    own = own[spread_out(vertices[own], APART * pixel)]
    if not len(own) or len(edges.face) < 2 * LEAST_NEAR:
        return none
    where = np.column_stack(
        [vertices[mesh[1][edges.face]].mean(axis=1) / pixel, NEAR * face_normals(*mesh)[edges.face]]
    )
    feature = np.column_stack([vertices[own] / pixel, NEAR * normal[own]])
    halves = []
    for half in (0, 1):
        member = np.flatnonzero(edges.view % 2 == half)
        if not len(member):
            return none
        distance, near = cKDTree(where[member]).query(feature, MOST_NEAR, distance_upper_bound=NEAR)
        known = np.isfinite(distance)
        gap = np.where(known, edges.gap[member][np.minimum(near, len(member) - 1)], np.nan)
        gap[known.sum(axis=1) < LEAST_NEAR] = np.nan
        halves.append(gap)
    told = np.flatnonzero(np.isfinite(halves[0]).any(axis=1) & np.isfinite(halves[1]).any(axis=1))
    if not len(told):
        return none
    first, second = (np.nanmedian(h[told], axis=1) for h in halves)
    both = np.nanmedian(np.concatenate([h[told] for h in halves], axis=1), axis=1)
    return own[told], in_common(feature[told], COMMON, first, second, both)


def _edges(
    mesh: Mesh, thin: np.ndarray, views: Views, grey: list[np.ndarray], support: np.ndarray | None, pixel: float
) -> _Edges:
    """Edges of the images next to the mesh's outlines, where it is `thin` (f,) bool and nothing lies close behind."""
    out = []
    for i, image in enumerate(grey):
        camera = views.K[i], views.R[i], views.t[i]
        depth, face = rasterise(*mesh, *camera, image.shape[::-1])
        at, border, outward = _outline(face >= 0)
        kept = thin[face[tuple(at.T)]]
        if support is not None:
            point = _places(at, depth[tuple(at.T)], *camera)
            kept &= _clear_of(support, point, views.centres[i]) > CLEAR * pixel
        at, border, outward = at[kept], border[kept], outward[kept]
        gap = _greatest_change(image, border, outward)
        told = np.isfinite(gap)
        at = at[told]
        scale = depth[tuple(at.T)] / views.K[i][0, 0]
        out.append(_Edges(face[tuple(at.T)], gap[told] * scale, np.full(len(at), i)))
    return _Edges(*(np.concatenate(part) for part in zip(*out, strict=True)))


def _outline(body: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (k, 2) row, column of the outermost of a drawn body (h, w) bool, where its border is (k, 2) x, y, and the direction out of it
    (k, 2) x, y; those at the image's edge are left out."""
    import cv2

    drawn = body.astype(np.float32)
    soft = cv2.GaussianBlur(drawn, (0, 0), BLUR)
    slope = [cv2.Scharr(soft, cv2.CV_32F, *order) / 32 for order in ((1, 0), (0, 1))]
    rim = body & (cv2.erode(body.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    rim[[0, -1]] = rim[:, [0, -1]] = False
    row, column = np.nonzero(rim)
    gradient = np.stack([s[row, column] for s in slope], axis=1)
    size = np.linalg.norm(gradient, axis=1)
    # of a straight border the slope is 0.4 a pixel; at corners and on hairs there is no way out
    kept = size > 0.5 / (np.sqrt(2 * np.pi) * BLUR)
    row, column, size = row[kept], column[kept], size[kept]
    outward = -gradient[kept] / size[:, None]
    border = np.column_stack([column, row]) + ((soft[row, column] - 0.5) / size)[:, None] * outward
    return np.column_stack([row, column]), border, outward


def _greatest_change(image: np.ndarray, border: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """(k,) how far outside the border the grey of an image (h, w) changes most [px]; not a number where it changes little, or
    most at an end of where it is looked for."""
    import cv2

    along = np.arange(-FARTHEST, FARTHEST + STEP / 2, STEP)
    if not len(border):
        return np.zeros(0)

    def at(way: np.ndarray) -> np.ndarray:
        place = (border[:, None] + way[None, :, None] * outward[:, None]).astype(np.float32)
        return cv2.remap(image.astype(np.float32), place, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    change = np.abs(at(along + SLOPE) - at(along - SLOPE)).astype(float)
    top = np.argmax(change, axis=1)
    n, k = np.arange(len(border)), np.clip(top, 1, len(along) - 2)
    told = (top == k) & (change[n, k] > LEAST_CHANGE)
    beyond = peak(change[n, k - 1], change[n, k], change[n, k + 1])
    return np.where(told, along[k] + STEP * beyond, np.nan)


def _places(at: np.ndarray, depth: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(k, 3) places in the world that pixels (k, 2) row, column show at a depth (k,)."""
    ray = np.column_stack([(at[:, 1] - K[0, 2]) / K[0, 0], (at[:, 0] - K[1, 2]) / K[1, 1], np.ones(len(at))])
    return np.asarray((depth[:, None] * ray - t) @ R)


def _clear_of(support: np.ndarray, point: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(k,) how far behind places (k, 3) the line of sight from `centre` (3,) meets the support (4,); infinite where it does not."""
    sight = point - centre
    length = np.linalg.norm(sight, axis=1)
    down = -(sight @ support[:3]) / length
    height = point @ support[:3] + support[3]
    return np.where(down > 1e-9, height / np.maximum(down, 1e-9), np.inf)
