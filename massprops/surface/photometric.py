"""Moves a closed surface to where the images of a still object agree best.

Stereo matches windows as planes, or bent as a noisy depth map bends. On plain convex sides that leaves the surface too deep in all
views alike: small windows that bend as the mesh does agree at the true place, there too, but each by itself says next to nothing.
So at places spread over the surface a small window is moved along the normal. How well the images agree there (mean normalised
cross-correlation of all pairs) is a curve over the distance moved. These curves are averaged over the surface about, and the surface
goes to their maxima (Vu, Labatut, Pons, Keriven 2012 descend the same measure), as far as halves of the images agree on that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from massprops.geometry.interpolation import peak
from massprops.geometry.projection import camera_rows
from massprops.geometry.rasterise import rasterise
from massprops.geometry.vectors import unit
from massprops.surface.moved import Mesh, averaging, in_common, moved, spread_out
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import edge_length, vertex_normals
from massprops.views import Views

Array = np.ndarray

RADIUS, STEPS, FARTHEST = 3, 21, 5.0
"""Of a window, of 7 x 7 places a pixel apart; places along the normal at which it is compared, and how far the outer ones are [px].
On the narrow sides of a bottle that stereo had 2.1 px too deep, windows of 7, 11 and 19 px were best 0, 0.5 and 2 px below the truth."""
NOISE = 2.0
"""Grey levels below which contrast says nothing."""
APART, MOST_PLACES = 3.0, 6000
"""Between places that are compared [px], or farther, and how many there are at most: each takes a millisecond."""
ABOUT, EDGES, NEIGHBOURS, LEAST_NEIGHBOURS = 8.0, 3.5, 64, 20
"""Surface within this distance [px], and within so many edges of the mesh, says how a window bends, by so many of its vertices at most,
and at least."""
MOST_ASIDE, LEAST_WIDTH = 0.25, 0.35
"""Of that distance: how far the middle of this surface may lie aside, and how wide (1-sigma) it must be each way; full discs have 0 and
0.5. At a rim, and on a part that is thin, a window shows what is not the surface."""
LEAST_FACING, HIDDEN = 0.35, 3.0
"""Cosine between the normal and the line of sight; distance behind the surface at which a place is hidden [px]."""
MOST_VIEWS, LEAST_VIEWS = 8, 3
"""Images of each half that are compared at a place, and those without which it says nothing."""
SPREAD = 12.0
"""1-sigma of the surface over which curves are averaged [px]; as far again in the normal, where it turns by a radian."""
COMMON = 2.0
"""How much wider the surface is over which the halves are compared."""


class _Images(NamedTuple):
    """All images as the kernel takes them: grey, one after the other; (n, 3) first pixel, rows, columns; (n, 16) fu fv cu cv, the
    rotation row by row, the translation."""

    grey: np.ndarray
    shape: np.ndarray
    camera: np.ndarray


class _Windows(NamedTuple):
    """Places (n, 3), their normals and two directions across (n, 3) each, and how windows bend (n, 5): the coefficients of u, v, u u,
    u v, v v of the height, u and v in pixels."""

    place: np.ndarray
    normal: np.ndarray
    across: np.ndarray
    down: np.ndarray
    bend: np.ndarray


def moved_to_images(
    surface: Surface, views: Views, grey: list[np.ndarray], masks: list[np.ndarray], placement: np.ndarray
) -> Surface:
    """The surface with its cloud, moved to where the images agree best, as `moved` does that.

    Args:
        views: n cameras; grey: n undistorted images (h, w); masks: n undistorted silhouettes (h, w), 255 object, 0 sky.
        placement: (n,) int: images are compared with those of the same placement, in which the light falls alike.
    """
    images, pixel = _packed(views, grey), surface.hull.pixel

    def ask(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
        may = _off_support(mesh[0], surface.hull.support, pixel)
        return offsets(mesh, may, views, images, placement, pixel)

    return moved(surface, ask, views, masks)


def offsets(
    mesh: tuple[np.ndarray, np.ndarray],
    may: np.ndarray,
    views: Views,
    images: _Images,
    placement: np.ndarray,
    pixel: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (k,) int, and how far outward the surface should move there (k,) [world units].

    Args:
        mesh: vertices (v, 3), faces (f, 3); may: (v,) bool, where that is asked; pixel: of an image at the object [world units].
    """
    chosen = np.flatnonzero(may)[spread_out(mesh[0][may], APART * pixel)]
    windows, whole = _windows(mesh, chosen, pixel)
    kept = np.flatnonzero(whole)
    kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), MOST_PLACES)).astype(int)]
    windows, chosen = _Windows(*(a[kept] for a in windows)), chosen[kept]
    view, start = _seen(mesh, windows, views, images, pixel)
    along = np.linspace(-FARTHEST, FARTHEST, STEPS)
    curves = np.zeros((len(chosen), 2, STEPS))
    _agreement(images, windows, view, start, placement, pixel, along, curves)
    known = np.isfinite(curves).all(axis=(1, 2))
    if np.count_nonzero(known) < LEAST_NEIGHBOURS:
        return np.zeros(0, int), np.zeros(0)
    chosen, curves = chosen[known], curves[known]
    feature = np.column_stack([windows.place[known] / pixel, SPREAD * windows.normal[known]])
    smooth = averaging(feature, SPREAD) @ curves.reshape(len(curves), -1)
    halves = smooth.reshape(curves.shape)
    first, second, both = (_highest(c, along) for c in (halves[:, 0], halves[:, 1], halves.mean(axis=1)))
    told = np.isfinite(first) & np.isfinite(second) & np.isfinite(both)
    first, second, both, feature = first[told], second[told], both[told], feature[told]
    return chosen[told], in_common(feature, COMMON * SPREAD, first, second, both) * pixel


def _off_support(vertices: np.ndarray, support: np.ndarray | None, pixel: float) -> np.ndarray:
    """(v,) bool: vertices about which no window reaches the support, which agrees with itself: the foot would move out along it."""
    if support is None:
        return np.ones(len(vertices), bool)
    return np.asarray(vertices @ support[:3] + support[3] > (RADIUS + FARTHEST) * pixel)


def _packed(views: Views, grey: list[np.ndarray]) -> _Images:
    size = np.array([g.size for g in grey])
    shape = np.array([(a, *g.shape) for a, g in zip(np.cumsum(size) - size, grey, strict=True)], np.int64)
    image = np.concatenate([g.ravel() for g in grey]).astype(np.float32)
    return _Images(image, shape, camera_rows(views.K, views.R, views.t))


def _windows(mesh: tuple[np.ndarray, np.ndarray], chosen: np.ndarray, pixel: float) -> tuple[_Windows, np.ndarray]:
    """Windows about the chosen vertices, bent as the surface about them, and (n,) bool, whether all of them is surface."""
    from scipy.spatial import cKDTree

    vertices, normals = mesh[0], vertex_normals(*mesh)
    about = max(ABOUT, EDGES * edge_length(*mesh) / pixel)
    place, normal = vertices[chosen], normals[chosen]
    near, index = cKDTree(vertices).query(place, NEIGHBOURS, distance_upper_bound=about * pixel)
    index = np.minimum(index, len(vertices) - 1)
    use = np.isfinite(near) & (np.einsum("nki,ni->nk", normals[index], normal) > 0.3)
    weight = use * _areas(mesh)[index]
    normal = unit(np.einsum("nk,nki->ni", weight, normals[index]) + 1e-9 * normal)
    across = unit(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)]))
    down = np.cross(normal, across)
    away = (vertices[index] - place[:, None]) / pixel
    u, v, h = (np.einsum("nki,ni->nk", away, axis) for axis in (across, down, normal))
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    system = np.einsum("nk,nka,nkb->nab", weight, terms, terms)
    trace = np.trace(system, axis1=1, axis2=2)[:, None, None]
    right = np.einsum("nk,nka,nk->na", weight, terms, h)
    bend = np.linalg.solve(system + 1e-9 * (trace + 1e-300) * np.eye(6), right[..., None])[..., 0]
    total = np.maximum(weight.sum(axis=1), 1e-300)
    flat = np.stack([u, v], axis=-1)
    aside = np.einsum("nk,nka->na", weight, flat) / total[:, None]
    spread = np.einsum("nk,nka,nkb->nab", weight, flat, flat) / total[:, None, None]
    narrow = np.sqrt(np.maximum(np.linalg.eigvalsh(spread - aside[:, :, None] * aside[:, None])[:, 0], 0.0))
    whole = (use.sum(axis=1) >= LEAST_NEIGHBOURS) & (narrow > LEAST_WIDTH * about)
    whole &= np.linalg.norm(aside, axis=1) < MOST_ASIDE * about
    return _Windows(place, normal, across, down, np.ascontiguousarray(bend[:, 1:])), whole


def _areas(mesh: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(v,) area about each vertex."""
    from massprops.mass.integrals import face_areas

    vertices, faces = mesh
    return np.bincount(faces.ravel(), np.repeat(face_areas(vertices, faces), 3), len(vertices))


def _seen(
    mesh: tuple[np.ndarray, np.ndarray], windows: _Windows, views: Views, images: _Images, pixel: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which images show each window whole: view (m,), those of window i at [start[i], start[i + 1])."""
    shown = np.zeros((len(windows.place), len(views)), bool)
    margin = RADIUS + FARTHEST + 2
    for i, centre in enumerate(views.centres):
        rows, columns = images.shape[i, 1:].tolist()
        depth = rasterise(*mesh, views.K[i], views.R[i], views.t[i], (columns, rows))[0]
        sight = centre - windows.place
        facing = np.einsum("ni,ni->n", sight, windows.normal) > LEAST_FACING * np.linalg.norm(sight, axis=1)
        camera = windows.place @ views.R[i].T + views.t[i]
        z = np.where(camera[:, 2] > 1e-9, camera[:, 2], 1.0)
        u, v = ((camera[:, k] / z * views.K[i][k, k] + views.K[i][k, 2]) for k in (0, 1))
        inside = (
            (camera[:, 2] > 1e-9) & (u > margin) & (v > margin) & (u < columns - 1 - margin) & (v < rows - 1 - margin)
        )
        at = np.flatnonzero(facing & inside)
        near = depth[np.rint(v[at]).astype(int), np.rint(u[at]).astype(int)]
        shown[at, i] = camera[at, 2] < near + HIDDEN * pixel
    return np.nonzero(shown)[1], np.concatenate([[0], np.cumsum(shown.sum(axis=1))])


@njit(cache=True, error_model="numpy")
def _agreement(
    images: _Images,
    windows: _Windows,
    view: Array,
    start: Array,
    placement: Array,
    pixel: float,
    along: Array,
    curves: Array,
) -> None:
    """Writes of each window and half of the images (n, 2, s) the mean correlation of pairs of them with the window moved `along`
    its normal [px]; not a number where too few show it."""
    side = 2 * RADIUS + 1
    samples = side * side
    groups = placement.max() + 1
    total, value = np.empty((groups, samples)), np.empty(samples)
    for n in range(len(windows.place)):
        for half in range(2):
            count = (start[n + 1] - start[n] + 1 - half) // 2
            if count < LEAST_VIEWS:
                curves[n, half] = np.nan
                continue
            taken = min(count, MOST_VIEWS)
            for s in range(len(along)):
                total[:] = 0.0
                pairs, squares = 0.0, 0.0
                members = np.zeros(groups)
                for k in range(taken):
                    i = view[start[n] + half + 2 * (k * count // taken)]
                    if not _window(images, windows, n, i, pixel, along[s], value):
                        continue
                    members[placement[i]] += 1.0
                    for j in range(samples):
                        total[placement[i], j] += value[j]
                        squares += value[j] * value[j]
                both = -squares
                for g in range(groups):
                    pairs += members[g] * (members[g] - 1.0)
                    for j in range(samples):
                        both += total[g, j] * total[g, j]
                curves[n, half, s] = both / (pairs * samples) if pairs >= LEAST_VIEWS * (LEAST_VIEWS - 1) else np.nan


@njit(inline="always", error_model="numpy")
def _window(images: _Images, windows: _Windows, n: int, i: int, pixel: float, along: float, value: Array) -> bool:
    """Writes what image i shows of the n-th window, with mean 0 and variance at most 1; False where it leaves the image."""
    first, rows, columns = images.shape[i]
    c = images.camera[i]
    bend = windows.bend[n]
    k, s1, s2 = 0, 0.0, 0.0
    for a in range(-RADIUS, RADIUS + 1):
        for b in range(-RADIUS, RADIUS + 1):
            h = along + bend[0] * a + bend[1] * b + bend[2] * a * a + bend[3] * a * b + bend[4] * b * b
            x = windows.place[n, 0] + pixel * (
                a * windows.across[n, 0] + b * windows.down[n, 0] + h * windows.normal[n, 0]
            )
            y = windows.place[n, 1] + pixel * (
                a * windows.across[n, 1] + b * windows.down[n, 1] + h * windows.normal[n, 1]
            )
            z = windows.place[n, 2] + pixel * (
                a * windows.across[n, 2] + b * windows.down[n, 2] + h * windows.normal[n, 2]
            )
            depth = c[10] * x + c[11] * y + c[12] * z + c[15]
            if depth <= 0.0:
                return False
            u = c[0] * (c[4] * x + c[5] * y + c[6] * z + c[13]) / depth + c[2]
            v = c[1] * (c[7] * x + c[8] * y + c[9] * z + c[14]) / depth + c[3]
            if not (u >= 0.0 and v >= 0.0 and u < columns - 1 and v < rows - 1):
                return False
            p, q = int(u), int(v)
            fu, fv = u - p, v - q
            at = first + q * columns + p
            top = images.grey[at] + fu * (images.grey[at + 1] - images.grey[at])
            low = images.grey[at + columns] + fu * (images.grey[at + columns + 1] - images.grey[at + columns])
            value[k] = top + fv * (low - top)
            s1 += value[k]
            s2 += value[k] * value[k]
            k += 1
    mean = s1 / k
    scale = 1.0 / np.sqrt(max(s2 / k - mean * mean, 0.0) + NOISE * NOISE)
    for j in range(k):
        value[j] = (value[j] - mean) * scale
    return True


def _highest(curves: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(n,) where each of the curves (n, s) is highest, by a parabola through three places; not a number at either end."""
    top = np.argmax(curves, axis=1)
    inside = (top > 0) & (top < len(along) - 1)
    k, n = np.clip(top, 1, len(along) - 2), np.arange(len(curves))
    beyond = peak(curves[n, k - 1], curves[n, k], curves[n, k + 1])
    return np.where(inside, along[k] + (along[1] - along[0]) * beyond, np.nan)
