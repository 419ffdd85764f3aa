"""Dark places of a closed surface that may be the mouths of holes, and how much they would take from the body.

Where stereo measures nothing in a bore, the surface is closed across it. A camera that looks in sees what lies deeper: it is
darker than the surface about it, and each view shows another part of it there. A plain side shows the same from everywhere,
a dark stain too. So a place counts where next to none of the measured surface is as dark and differs as much from view to
view. How deep it goes nothing tells: at most straight on, through the body, up to a wall that was measured.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from massprops.geometry.projection import pixels_of
from massprops.geometry.rasterise import rasterise
from massprops.mass.integrals import face_areas
from massprops.surface.hollow import integrals_of, solid_of, within
from massprops.surface.layers import Layers, layers_across
from massprops.surface.refine import face_normals
from massprops.views import Views

AS_DARK, AS_CHANGING = 0.05, 0.25
"""Share of the measured surface that is as dark as a place at most, and share that changes as much: a stain is dark, and paint
at an edge changes, but neither is both. Of a machined part's bores (Blender) .01 to .03 are as dark and .04 to .22 change as
much; of a box's dark glossy print, which stereo does not measure either, .07 to .11 and .05 to .11."""
AS_RARE = 0.01
"""Product of the two shares below which a place may be a hole."""
FEWEST = 4
"""Views that must show a place."""
FACING = 0.3
"""Cosine between surface and line of sight below which a view does not count."""
SEEN = 0.5
"""Share of a place that so many views must show."""
MOST_SAMPLES = 8000
"""Measured faces that places are compared with."""
BLUR_PX = 1.0
DARKEST = 0.05
"""Of the median grey: added before the logarithm, so that noise of what is black is no change."""
SMALLEST = 12.0
"""Area of a place, in squares of the mesh's spacing, below which it is left out."""
BEHIND = 2.0
"""A face that lies farther behind the first one seen, in spacings, is hidden."""


class Surface(Protocol):
    """What is asked of a closed surface (`reconstruct.Surface`).

    Attributes:
        vertices: (v, 3); faces: (f, 3), wound outward; observed, inferred: (f,) bool, measured faces and those closed at the
            support.
        noise: of the measured surface, the least thickness that it proves; spacing: of the vertices.
    """

    @property
    def vertices(self) -> np.ndarray: ...
    @property
    def faces(self) -> np.ndarray: ...
    @property
    def observed(self) -> np.ndarray: ...
    @property
    def inferred(self) -> np.ndarray: ...
    @property
    def noise(self) -> float: ...
    @property
    def spacing(self) -> float: ...


def dark_places(body: Surface, views: Views, grey: list[np.ndarray]) -> list[np.ndarray]:
    """Dark places among the filled faces that the views show differently, of each the indices of its faces.

    A hole is a gap in what was measured: a place larger than all of that is a side that was not.

    Args:
        body: closed and wound outward.
        grey: images (h, w) of the views, undistorted.
    """
    normal, area = face_normals(body.vertices, body.faces), face_areas(body.vertices, body.faces)
    places = _places(body.faces, area, ~body.observed & ~body.inferred, SMALLEST * body.spacing**2)
    places = [place for place in places if area[place].sum() < area[body.observed].sum()]
    if not places:
        return []
    some = np.flatnonzero(body.observed)
    some = some[:: max(1, len(some) // MOST_SAMPLES)]
    looked = np.concatenate([some, *places])
    values = _values(body, normal, looked, views, grey)
    brightness, change, shown = _seen(values, len(some))
    measured_shown = shown[: len(some)]
    measured = brightness[: len(some)][measured_shown], change[: len(some)][measured_shown]
    dark, begin = [], len(some)
    for place in places:
        part = slice(begin, begin + len(place))
        begin += len(place)
        good = shown[part]
        if good.mean() < SEEN or not len(measured[0]):
            continue
        as_dark = float(np.mean(measured[0] <= np.median(brightness[part][good])))
        as_changing = float(np.mean(measured[1] >= np.median(change[part][good])))
        if as_dark < AS_DARK and as_changing < AS_CHANGING and as_dark * as_changing < AS_RARE:
            dark.append(place)
    return dark


def _places(faces: np.ndarray, area: np.ndarray, filled: np.ndarray, least: float) -> list[np.ndarray]:
    """Filled faces that hang together, as indices, of each place larger than `least`; area (f,) of all faces (f, 3)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    filled_faces = np.flatnonzero(filled)
    if not len(filled_faces):
        return []
    edges = np.sort(np.concatenate([faces[filled_faces][:, k] for k in ([0, 1], [1, 2], [2, 0])]), axis=1)
    which = np.tile(np.arange(len(filled_faces)), 3)
    order = np.lexsort(edges.T)
    edges, which = edges[order], which[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    pairs = which[:-1][same], which[1:][same]
    graph = coo_matrix((np.ones(len(pairs[0])), pairs), shape=(len(filled_faces), len(filled_faces)))
    _, label = connected_components(graph, directed=False)
    large = np.flatnonzero(np.bincount(label, area[filled_faces]) > least)
    return [filled_faces[label == k] for k in large]


def _values(body: Surface, normal: np.ndarray, looked: np.ndarray, views: Views, grey: list[np.ndarray]) -> np.ndarray:
    """(n, k) grey levels of faces `looked` (k,) in the views, NaN where a view does not show one well."""
    import cv2

    middle = body.vertices[body.faces[looked]].mean(axis=1)
    value = np.full((len(views), len(looked)), np.nan, np.float32)
    for i, image in enumerate(grey):
        h, w = image.shape
        blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_PX)
        depth, _ = rasterise(body.vertices, body.faces, views.K[i], views.R[i], views.t[i], (w, h))
        x = middle @ views.R[i].T + views.t[i]
        along = -np.einsum("ij,ij->i", normal[looked] @ views.R[i].T, x) / np.linalg.norm(x, axis=1)
        in_image, rows, columns = pixels_of(middle, views.K[i], views.R[i], views.t[i], image.shape)
        shown = (along[in_image] > FACING) & (x[in_image, 2] < depth[rows, columns] + BEHIND * body.spacing)
        value[i, in_image[shown]] = blurred[rows[shown], columns[shown]]
    return value


def _seen(value: np.ndarray, measured: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the grey levels (n, k) of faces, the first so many of them measured: the median over the views of their brightness,
    over that of the measured ones in each; the standard deviation of its logarithm; whether enough views show them, all (k,)."""
    usable_views = np.isfinite(value[:, :measured]).any(axis=1)
    value = value[usable_views] / np.maximum(np.nanmedian(value[usable_views, :measured], axis=1), 1.0)[:, None]
    shown = np.isfinite(value).sum(axis=0) >= FEWEST
    brightness, change = (np.full(value.shape[1], np.nan) for _ in range(2))
    brightness[shown] = np.nanmedian(value[:, shown], axis=0)
    change[shown] = np.nanstd(np.log(value[:, shown] + DARKEST), axis=0)
    return brightness, change, shown


def straight_behind(body: Surface, places: list[np.ndarray]) -> np.ndarray:
    """Integrals (10,), about the origin of the vertices, of the cells of the body that lie straight behind a place and the section that the
    walls before it leave free, against its mean normal, up to where the body ends, less the wall that a measured far side proves."""
    if not places:
        return np.zeros(10)
    vertices, faces = body.vertices, body.faces
    normal = face_normals(vertices, faces)
    grid, solid = solid_of(vertices, faces)
    index = np.argwhere(solid)
    middle = grid.world(index)
    empty = np.zeros(len(index), bool)
    for place in places:
        mean = face_areas(vertices, faces[place]) @ normal[place]
        if np.linalg.norm(mean) > 0.0:
            empty |= _below(middle, vertices, faces, place, mean / np.linalg.norm(mean))
    kept = np.flatnonzero(empty)
    proven = within(middle[kept], vertices, faces[body.observed], body.noise)
    return integrals_of(index[kept[~proven]], grid)


def _below(
    points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, place: np.ndarray, up: np.ndarray
) -> np.ndarray:
    """(k,) bool: points (k, 3) of the body above which, along `up`, it ends at a face of the place, or in the free section before it."""
    layers = layers_across(vertices, faces, up)
    if layers is None:
        return np.zeros(len(points), bool)
    grid, cell, height = layers.grid, layers.cell, layers.height
    ends = np.isin(layers.face, place)
    free = _free_section(layers, ends)
    grid_points = points @ grid.base.T + [0.0, 0.0, grid.offset]
    column = np.floor((grid_points[:, :2] - grid.corner[:2]) / grid.step[:2]).astype(int)
    flat = column[:, 0] * int(grid.shape[1]) + column[:, 1]
    # the first crossing of each point's column that lies above it
    span = float(np.ptp(height)) * 4.0 + 1.0
    low = float(height.min(initial=0.0))
    key = cell * span + (height - low)
    after = np.searchsorted(key, flat * span + np.clip(grid_points[:, 2] - low, 0.0, 0.5 * span))
    there = np.minimum(after, max(len(cell) - 1, 0))
    has_crossing = (after < len(cell)) & (cell[there] == flat)
    return np.asarray(has_crossing & (ends[there] | (height[there] <= free[flat])))


def _free_section(layers: Layers, ends: np.ndarray) -> np.ndarray:
    """(columns,) height up to which a column before a place is free, while the body encloses that section all about; -inf of the others.

    A bore is closed where nothing was measured deep in it, and narrows towards there: the walls at its mouth show how wide it is.

    Args:
        ends: (c,) bool, the crossings of `layers` at a face of the place.
    """
    floor = np.full(layers.piece.shape[:2], np.inf)
    np.minimum.at(floor.reshape(-1), layers.cell[ends], layers.height[ends])
    level = layers.grid.corner[2] + (np.arange(layers.piece.shape[2]) + 0.5) * layers.grid.step[2]
    before = np.unique(layers.piece[level > floor[:, :, None]])
    enclosed = np.isin(layers.piece, before[before > 0])
    return np.asarray(np.where(enclosed, level, -np.inf).max(axis=2).ravel())
