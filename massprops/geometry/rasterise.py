"""Triangles seen by a pinhole camera: a depth buffer, and which face each pixel shows."""

from __future__ import annotations

import numpy as np
from numba import njit

from massprops.geometry.projection import project


def rasterise(
    vertices: np.ndarray, faces: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The nearest face at the centre of every pixel.

    Faces that reach behind the camera are left out.

    Args:
        vertices: (v, 3) in the world; faces: (f, 3) int.
        K: (3, 3) pinhole matrix [px], centres of pixels at whole numbers.
        R: (3, 3), t: (3,): world to camera, z forward.
        size: width, height [px].

    Returns:
        depth (h, w) float64, infinite where nothing is; face (h, w) int32, -1 where nothing is.
    """
    uv, z = project(vertices, K, R, t)
    depth = np.full((size[1], size[0]), np.inf)
    face = np.full((size[1], size[0]), -1, np.int32)
    _fill(np.ascontiguousarray(uv), np.ascontiguousarray(z), np.ascontiguousarray(faces, np.int64), depth, face)
    return depth, face


def silhouette(
    vertices: np.ndarray, faces: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """(h, w) bool: pixels whose centre the mesh covers. Arguments as for `rasterise`."""
    uv, z = project(vertices, K, R, t)
    seen = np.zeros((size[1], size[0]), bool)
    _cover(np.ascontiguousarray(uv), np.ascontiguousarray(z), np.ascontiguousarray(faces, np.int64), seen)
    return seen


@njit(cache=True, error_model="numpy")
def _fill(uv: np.ndarray, z: np.ndarray, faces: np.ndarray, depth: np.ndarray, face: np.ndarray) -> None:
    """Writes depth (h, w) and face (h, w); uv: (v, 2) [px] and z: (v,) of the vertices; faces: (f, 3)."""
    for f in range(len(faces)):
        (x0, x1, y0, y1), (ax, ay, bx, by, cx, cy), area = _triangle(uv, z, faces[f], depth.shape)
        if x0 > x1 or y0 > y1:
            continue
        ia, ib, ic = 1.0 / z[faces[f, 0]], 1.0 / z[faces[f, 1]], 1.0 / z[faces[f, 2]]
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                p = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                q = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                r = 1.0 - p - q
                if p < 0.0 or q < 0.0 or r < 0.0:
                    continue
                # inverse depth is linear in the image
                d = 1.0 / (p * ia + q * ib + r * ic)
                if d < depth[y, x]:
                    depth[y, x] = d
                    face[y, x] = f


@njit(cache=True, error_model="numpy")
def _cover(uv: np.ndarray, z: np.ndarray, faces: np.ndarray, seen: np.ndarray) -> None:
    """Writes seen (h, w) bool; the others as of `_fill`. Twice as fast: a pixel is asked once, without its depth."""
    for f in range(len(faces)):
        (x0, x1, y0, y1), (ax, ay, bx, by, cx, cy), area = _triangle(uv, z, faces[f], seen.shape)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                if not seen[y, x]:
                    p = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                    q = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                    seen[y, x] = p >= 0.0 and q >= 0.0 and 1.0 - p - q >= 0.0


@njit(cache=True, error_model="numpy")
def _triangle(
    uv: np.ndarray, z: np.ndarray, face: np.ndarray, shape: tuple[int, int]
) -> tuple[tuple[int, int, int, int], tuple[float, float, float, float, float, float], float]:
    """First and last column and row of the pixels that a face may cover, its corners and twice its area in the image; no pixels where it
    reaches behind the camera or is seen edge-on."""
    a, b, c = face
    ax, ay, bx, by, cx, cy = uv[a, 0], uv[a, 1], uv[b, 0], uv[b, 1], uv[c, 0], uv[c, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0 or min(z[a], z[b], z[c]) <= 1e-9:
        return (0, -1, 0, -1), (ax, ay, bx, by, cx, cy), area
    h, w = shape
    x0, x1 = max(0.0, np.ceil(min(ax, bx, cx))), min(w - 1.0, np.floor(max(ax, bx, cx)))
    y0, y1 = max(0.0, np.ceil(min(ay, by, cy))), min(h - 1.0, np.floor(max(ay, by, cy)))
    box = (int(min(x0, float(w))), int(max(x1, -1.0)), int(min(y0, float(h))), int(max(y1, -1.0)))
    return box, (ax, ay, bx, by, cx, cy), area
