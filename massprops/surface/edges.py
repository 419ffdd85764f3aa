"""Moves the thin parts of a still object to where its edges are in the images.

Legs, blades and plates are narrower than a window of stereo: whatever it matches there is half background, and no window fits on them
to be compared once more (`photometric`). Their edges are sharp in the images all the same. Across the outline of the mesh in every
image is looked where the grey changes. A pattern behind changes, too, but elsewhere in every image, so what many images show about a
place is averaged, and the outermost place that stands out is the edge: creases and paint lie within it. The surface goes there, as far as halves
of the images agree on that.

Where the support lies close behind an outline, the object's own shade has an edge there. That is not asked.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprops.geometry.interpolation import peak
from massprops.geometry.rasterise import rasterise
from massprops.surface.fill_bounds import thickness
from massprops.surface.moved import Mesh, averaging, in_common, moved, spread_out
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import face_normals, vertex_normals
from massprops.views import Views

ALONG = np.linspace(-6.0, 6.0, 25)
"""How far outside the mesh's outline the grey's change is asked for [px]; edges are looked for WIDTH within."""
WIDTH = 2.0
"""Beyond this on either side of an edge the grey's change is no longer the edge's [px]; it is more on the side of the object, which draws the highest place
inward, so an edge is held against the mean of both sides."""
STANDS_OUT = 0.5
"""Of the height of the greatest change over the least, that of a place that counts."""
SLOPE = 1.0
"""How far on either side of a place, over which the grey's change is taken [px]."""
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
SPREAD, COMMON = 6.0, 24.0
"""1-sigma of the surface over which changes are averaged, and over which halves of the images are compared [px]. On a chair whose legs and back
were 0.40 px too thin in the mean, what came out was 0.33, 0.42 and 0.49 px with 3, 6 and 12 px."""
BLUR = 1.0
"""1-sigma by which the drawn mesh is blurred, to tell which way its outline runs and where between pixels it lies [px]."""


class _Edges(NamedTuple):
    """Faces (k,) int on outlines of the mesh, how much the grey changes at places across them (k, s), each over all of them, and the view
    (k,) int."""

    face: np.ndarray
    change: np.ndarray
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
    none = np.zeros(0, int), np.zeros(0)
    thin = thickness(mesh, np.arange(len(mesh[1]))) < THIN * pixel
    edges = _edges(mesh, thin, views, grey, support, pixel)
    vertices, normal = mesh[0], vertex_normals(*mesh)
    thin_vertices = np.unique(mesh[1][thin])
    thin_vertices = thin_vertices[spread_out(vertices[thin_vertices], APART * pixel)]
    if not len(thin_vertices) or len(edges.face) < 2 * LEAST_NEAR:
        return none
    where = np.column_stack(
        [vertices[mesh[1][edges.face]].mean(axis=1) / pixel, NEAR * face_normals(*mesh)[edges.face]]
    )
    feature = np.column_stack([vertices[thin_vertices] / pixel, NEAR * normal[thin_vertices]])
    over = averaging(feature, SPREAD)
    halves = [over @ _about(feature, where[m], edges.change[m]) for m in (edges.view % 2 == half for half in (0, 1))]
    first, second, both = (outermost(c) for c in (*halves, halves[0] + halves[1]))
    told = np.isfinite(first) & np.isfinite(second) & np.isfinite(both)
    if not told.any():
        return none
    return thin_vertices[told], pixel * in_common(feature[told], COMMON, first[told], second[told], both[told])


def outermost(change: np.ndarray) -> np.ndarray:
    """(n,) how far outside the outline the outermost edge is [px], by how much the grey changes (n, s) at places ALONG; not a number
    where nothing stands out."""
    beside = round(WIDTH / (ALONG[1] - ALONG[0]))
    over = change[:, beside:-beside] - 0.5 * (change[:, : -2 * beside] + change[:, 2 * beside :])
    left, middle, right = over[:, :-2], over[:, 1:-1], over[:, 2:]
    least, most = over.min(axis=1, keepdims=True), over.max(axis=1, keepdims=True)
    stands_out = (middle >= left) & (middle > right) & (middle - least >= STANDS_OUT * (most - least))
    n, k = np.arange(len(over)), middle.shape[1] - 1 - np.argmax(stands_out[:, ::-1], axis=1)
    beyond = peak(left[n, k], middle[n, k], right[n, k])
    place = ALONG[beside + 1 + k] + (ALONG[1] - ALONG[0]) * beyond
    return np.where(stands_out.any(axis=1), place, np.nan)


def _about(feature: np.ndarray, where: np.ndarray, change: np.ndarray) -> np.ndarray:
    """(n, s) mean change across the outlines `where` (k, 6) about places in a space of features (n, 6); zero where there are too few."""
    from scipy.spatial import cKDTree

    if len(where) < LEAST_NEAR:
        return np.zeros((len(feature), change.shape[1]))
    distance, near = cKDTree(where).query(feature, min(MOST_NEAR, len(where)), distance_upper_bound=NEAR)
    known = np.isfinite(distance)
    total = np.einsum("nk,nks->ns", known.astype(float), change[np.minimum(near, len(where) - 1)])
    return np.where(known.sum(axis=1)[:, None] < LEAST_NEAR, 0.0, total / np.maximum(known.sum(axis=1), 1)[:, None])


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
        change = _change(image, border, outward)
        told = change.max(axis=1, initial=0.0) > LEAST_CHANGE
        change = change[told] / change[told].sum(axis=1, keepdims=True)
        out.append(_Edges(face[tuple(at[told].T)], change, np.full(len(change), i)))
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


def _change(image: np.ndarray, border: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """(k, s) how much the grey of an image (h, w) changes at places ALONG the ways out of the border (k, 2) x, y."""
    import cv2

    if not len(border):
        return np.zeros((0, len(ALONG)))

    def at(way: np.ndarray) -> np.ndarray:
        place = (border[:, None] + way[None, :, None] * outward[:, None]).astype(np.float32)
        return cv2.remap(image.astype(np.float32), place, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    return np.abs(at(ALONG + SLOPE) - at(ALONG - SLOPE)).astype(float)


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
