"""The largest body that darkness allows: space carving before a black sky.

A pixel as dark as the sky shows nothing there, or a side that no light reaches. So a place on the surface of a shape that is too large is
empty where images show sky and it would be lit: it faces the camera and the Sun, and nothing of the shape lies between. Such places are
taken away shell by shell, until none is left. What a smaller body hides or shades a larger one hides or shades, too, so nothing of
the body is ever taken (Kutulakos and Seitz 2000, "A theory of shape by space carving", with darkness in place of colour).

Taken whole, the sight line through such a place would be called empty as far as it goes, and with it sides behind that are dark.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from massprops.surface.level_set import level_set
from massprops.surface.silhouette import FEWEST_AGREE, Hull
from massprops.views import Views

Array = np.ndarray

SIDE = 160
"""Places along the longest side of the grid: 4 to 6 px of a body of 340 px. With 112, of 6 px, a rock of which 41 % was never lit came out 5 % too small, with
160 1 %; it is the one that these numbers were set on."""
BESIDE = 0.5
"""Room about what was measured, of its longest side, that an unmeasured side may reach into: as far as the other half of a ball."""
OUTLIERS = 0.001
"""Share of measured points on either side that do not say where the grid begins."""
LIT = 0.2
"""Cosine between a side and the Sun, and between it and the line of sight, from which on it would be seen: normals on a grid and the Sun's
direction are known to some 5 degrees each."""
SMOOTH = 1.5
"""1-sigma over which places are averaged for the direction of a surface [places]."""
CLEAR = 2.5
"""Way from a place outside a surface on which that does not hide or shade itself [places]."""
RESTS = 2e-5
"""Share of the shape in a shell below which carving ends."""


class _Seen(NamedTuple):
    """What the images show: sky (n, h, w) uint8; P (n, 3, 4) to their pixels, centre (n, 3) and sun (n, 3) in the world."""

    sky: Array
    P: Array
    centre: Array
    sun: Array


def carved(
    views: Views, sky: list[np.ndarray], towards: np.ndarray, hull: Hull, measured: np.ndarray, side: int = SIDE
) -> tuple[np.ndarray, np.ndarray, float]:
    """Closed mesh (v, 3), (f, 3) of the largest shape within a hull that shows nothing lit before sky, and its grid's step.

    Args:
        views: n cameras; sky: (h, w) bool of each, pixels that surely show none of the body's lit sides.
        towards: (n, 3) to the Sun, in each view's camera.
        hull: of silhouettes whose sky is empty whatever the light.
        measured: (m, 3) points that are known to be on the body.
        side: places along the longest side of the grid.
    """
    from scipy.ndimage import binary_dilation, gaussian_filter

    low, high = np.quantile(measured, [OUTLIERS, 1.0 - OUTLIERS], axis=0)
    room = BESIDE * float((high - low).max())
    step = (float((high - low).max()) + 2 * room) / side
    origin = low - room - step
    size = np.ceil((high + room - origin) / step).astype(int) + 2
    slab = np.stack(np.meshgrid([0], *map(np.arange, size[1:]), indexing="ij"), axis=-1).reshape(-1, 3)
    # slab by slab: the hull asks as much memory of a place as it counts views
    inside = [hull.value(origin + step * (slab + [i, 0, 0])) < 0 for i in range(size[0])]
    body = np.stack(inside).reshape(size)
    for axis in range(3):  # a border of sky
        np.moveaxis(body, axis, 0)[[0, -1]] = False
    kept = np.zeros(size, bool)
    at = np.rint((measured - origin) / step).astype(int)
    kept[tuple(at[((at > 0) & (at < size - 1)).all(axis=1)].T)] = True
    kept = binary_dilation(kept)
    body |= kept
    seen = _seen(views, sky, towards, hull)
    need = FEWEST_AGREE * hull.at_once
    for _ in range(side):
        at = np.argwhere(_outermost(body) & ~kept)
        gone = at[_votes(body, at, _normals(body, at), origin, step, seen) >= need]
        body[tuple(gone.T)] = False
        if len(gone) <= RESTS * np.count_nonzero(body):
            break
    # a little softened, so that the mesh's normals are none of the grid's
    vertices, faces = level_set(0.5 - gaussian_filter(body.astype(np.float32), 0.7), origin, step)
    return vertices, faces, step


def _outermost(body: np.ndarray) -> np.ndarray:
    """(a, b, c) bool: places of a shape beside one that is not its own."""
    from scipy.ndimage import binary_erosion

    return np.asarray(body & ~binary_erosion(body))


def _normals(body: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(k, 3) unit, outward, at outermost places (k, 3) of a shape; its border is empty."""
    from scipy.ndimage import gaussian_filter

    soft = gaussian_filter(body.astype(np.float32), SMOOTH)
    slope = np.stack([soft[tuple((at + d).T)] - soft[tuple((at - d).T)] for d in np.eye(3, dtype=int)], axis=1)
    slope = slope.astype(float)
    return -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)


def _seen(views: Views, sky: list[np.ndarray], towards: np.ndarray, hull: Hull) -> _Seen:
    """What the images show; beyond one of them nothing is sky."""
    h, w = (max(s.shape[k] for s in sky) for k in (0, 1))
    whole = np.zeros((len(sky), h, w), np.uint8)
    for i, one in enumerate(sky):
        whole[i, : one.shape[0], : one.shape[1]] = one
    return _Seen(whole, hull.P, views.centres, np.einsum("nji,nj->ni", views.R, towards))


@njit(cache=True, error_model="numpy")
def _blocked(body: Array, x: Array, direction: Array) -> bool:
    """Whether the shape lies on a ray from x (3,) [places] in a unit direction."""
    t = CLEAR
    while True:
        i = int(math.floor(x[0] + t * direction[0] + 0.5))
        j = int(math.floor(x[1] + t * direction[1] + 0.5))
        k = int(math.floor(x[2] + t * direction[2] + 0.5))
        if i < 0 or j < 0 or k < 0 or i >= body.shape[0] or j >= body.shape[1] or k >= body.shape[2]:
            return False
        if body[i, j, k]:
            return True
        t += 0.7


@njit(cache=True, error_model="numpy")
def _votes(body: Array, at: Array, normal: Array, origin: Array, step: float, seen: _Seen) -> Array:
    """(k,) images that show sky where the places `at` (k, 3) of a shape would be seen lit."""
    sky, P, centre, sun = seen
    out = np.zeros(len(at), np.int64)
    x, sight = np.empty(3), np.empty(3)
    for m in range(len(at)):
        X, Y, Z = origin[0] + step * at[m, 0], origin[1] + step * at[m, 1], origin[2] + step * at[m, 2]
        for k in range(3):
            x[k] = at[m, k] + normal[m, k]
        for v in range(len(P)):
            s = sun[v]
            if normal[m, 0] * s[0] + normal[m, 1] * s[1] + normal[m, 2] * s[2] < LIT:
                continue
            d = P[v, 2, 0] * X + P[v, 2, 1] * Y + P[v, 2, 2] * Z + P[v, 2, 3]
            if d <= 1e-9:
                continue
            a = (P[v, 0, 0] * X + P[v, 0, 1] * Y + P[v, 0, 2] * Z + P[v, 0, 3]) / d
            b = (P[v, 1, 0] * X + P[v, 1, 1] * Y + P[v, 1, 2] * Z + P[v, 1, 3]) / d
            i, j = int(math.floor(b + 0.5)), int(math.floor(a + 0.5))
            if i < 0 or j < 0 or i >= sky.shape[1] or j >= sky.shape[2] or sky[v, i, j] == 0:
                continue
            sight[0], sight[1], sight[2] = centre[v, 0] - X, centre[v, 1] - Y, centre[v, 2] - Z
            far = math.sqrt(sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2)
            for k in range(3):
                sight[k] /= far
            if normal[m, 0] * sight[0] + normal[m, 1] * sight[1] + normal[m, 2] * sight[2] < LIT:
                continue
            if _blocked(body, x, s) or _blocked(body, x, sight):
                continue
            out[m] += 1
    return out
