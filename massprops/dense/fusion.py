"""Depth maps that agree, made into one cloud of points with normals, noise and the views that saw them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba as nb
import numpy as np

from massprops.core.parts import Arrays

Array = np.ndarray

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class DensePoints:
    """Measured surface points.

    Attributes:
        xyz: (n, 3) float32 [units of the reconstruction].
        normal: (n, 3) float32, outward.
        rgb: (n, 3) uint8.
        sigma: (n,) float32, one sigma of the position along the normal.
        view_start: (n + 1,) int32, view_index: (k,) int32: the views that saw point i are
            view_index[view_start[i]:view_start[i + 1]].
    """

    xyz: np.ndarray
    normal: np.ndarray
    rgb: np.ndarray
    sigma: np.ndarray
    view_start: np.ndarray
    view_index: np.ndarray


class Maps(NamedTuple):
    """Depth maps of one size: depth, sigma (r, h, w) float32; normal (r, h, w, 3) float32 in each camera."""

    depth: np.ndarray
    normal: np.ndarray
    sigma: np.ndarray

    def enter(self, n: int, found: Arrays, where: np.ndarray | None) -> None:
        """Takes the n-th map from its `depth`, `normal` and `sigma`, all of it or `where` (h, w) bool says."""
        for maps, new in ((self.depth, found["depth"]), (self.normal, found["normal"]), (self.sigma, found["sigma"])):
            maps[n] = new if where is None else np.where(where if new.ndim == 2 else where[..., None], new, maps[n])


class Cameras(NamedTuple):
    """The maps' cameras: K (r, 4) fu fv cu cv; R (r, 3, 3), t (r, 3): world to camera."""

    K: np.ndarray
    R: np.ndarray
    t: np.ndarray


class Agreement(NamedTuple):
    """When maps agree on a point.

    Attributes:
        confirming: maps that must confirm a pixel.
        reprojection: forward and back, at most [px].
        depth: relative, at most.
        normal: least cosine.
    """

    confirming: int = 2
    reprojection: float = 1.0
    depth: float = 0.01
    normal: float = 0.6


class _Fused(NamedTuple):
    """Room for the points of one reference: xyz, normal (n, 3), sigma (n,), pixel (n,), and how many maps saw each,
    count (n,), and which, seen (n, most)."""

    xyz: np.ndarray
    normal: np.ndarray
    sigma: np.ndarray
    pixel: np.ndarray
    count: np.ndarray
    seen: np.ndarray


def nothing_measured() -> DensePoints:
    """No points."""
    none = np.zeros((0, 3), np.float32)
    return DensePoints(none, none, none.astype(np.uint8), none[:, 0], np.zeros(1, np.int32), np.zeros(0, np.int32))


@nb.njit(error_model="numpy")
def _turned_back(R: Array, a: float, b: float, c: float) -> Vector:
    """R^T (a, b, c)."""
    return (
        R[0, 0] * a + R[1, 0] * b + R[2, 0] * c,
        R[0, 1] * a + R[1, 1] * b + R[2, 1] * c,
        R[0, 2] * a + R[1, 2] * b + R[2, 2] * c,
    )


@nb.njit(error_model="numpy")
def _in_camera(R: Array, t: Array, x: float, y: float, z: float) -> Vector:
    """R (x, y, z) + t."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0],
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1],
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2],
    )


@nb.njit(error_model="numpy")
def _precision(sigma: float, ray: float, facing: float) -> float:
    """Weight of a depth along its normal; ray: length of the line of sight at unit depth, facing: its cosine."""
    s = sigma * ray * max(facing, 0.05)
    return 1.0 / (s * s)


@nb.njit(error_model="numpy")
def _confirmed(
    maps: Maps,
    cameras: Cameras,
    limits: Agreement,
    reference: int,
    x: int,
    y: int,
    v: int,
    point: Vector,
    normal: Vector,
) -> tuple[bool, int, int, float, Vector, Vector]:
    """Whether map v has the point that the reference sees at pixel (x, y): the pixel there, weight, point, normal."""
    nothing = (False, 0, 0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    K, R, t = cameras.K[v], cameras.R[v], cameras.t[v]
    a, b, e = _in_camera(R, t, *point)
    if e <= 0.0:
        return nothing
    u_, v_ = K[0] * a / e + K[2], K[1] * b / e + K[3]
    j, i = int(round(u_)), int(round(v_))
    if i < 0 or j < 0 or i >= maps.depth.shape[1] or j >= maps.depth.shape[2]:
        return nothing
    g = maps.depth[v, i, j]
    if g <= 0.0:
        return nothing
    q0, q1, q2 = maps.normal[v, i, j, 0], maps.normal[v, i, j, 1], maps.normal[v, i, j, 2]
    # the partner's plane where the projected ray meets it, not at the pixel's middle
    rx, ry = (u_ - K[2]) / K[0], (v_ - K[3]) / K[1]
    px, py = (j - K[2]) / K[0], (i - K[3]) / K[1]
    slope = q0 * rx + q1 * ry + q2
    if slope > -0.05:
        return nothing
    depth = g * (q0 * px + q1 * py + q2) / slope
    if abs(depth - e) > limits.depth * e:
        return nothing
    partner_normal = _turned_back(R, q0, q1, q2)
    if limits.normal > partner_normal[0] * normal[0] + partner_normal[1] * normal[1] + partner_normal[2] * normal[2]:
        return nothing
    there = _turned_back(R, rx * depth - t[0], ry * depth - t[1], depth - t[2])
    # back in the reference
    K = cameras.K[reference]
    a, b, e = _in_camera(cameras.R[reference], cameras.t[reference], *there)
    if e <= 0.0:
        return nothing
    du, dv = K[0] * a / e + K[2] - x, K[1] * b / e + K[3] - y
    if du * du + dv * dv > limits.reprojection * limits.reprojection:
        return nothing
    ray = math.sqrt(rx * rx + ry * ry + 1.0)
    return True, i, j, _precision(maps.sigma[v, i, j], ray, -slope / ray), there, partner_normal


@nb.njit(error_model="numpy")
def _seen_first(maps: Maps, cameras: Cameras, reference: int, x: int, y: int) -> tuple[float, Vector, Vector]:
    """What a map itself says of its pixel: weight, point, normal."""
    K, R, t = cameras.K[reference], cameras.R[reference], cameras.t[reference]
    d, m = maps.depth[reference, y, x], maps.normal[reference, y, x]
    rx, ry = (x - K[2]) / K[0], (y - K[3]) / K[1]
    point = _turned_back(R, rx * d - t[0], ry * d - t[1], d - t[2])
    ray = math.sqrt(rx**2 + ry**2 + 1.0)
    facing = -(m[0] * (x - K[2]) / K[0] + m[1] * (y - K[3]) / K[1] + m[2]) / ray
    return _precision(maps.sigma[reference, y, x], ray, facing), point, _turned_back(R, m[0], m[1], m[2])


@nb.njit(error_model="numpy")
def _added(sums: tuple[float, ...], w: float, p: Vector, n: Vector, off: float) -> tuple[float, ...]:
    """Sums of weight, weighted point and normal, and the weighted distance along the reference's normal and its square."""
    return (
        sums[0] + w,
        sums[1] + w * p[0],
        sums[2] + w * p[1],
        sums[3] + w * p[2],
        sums[4] + w * n[0],
        sums[5] + w * n[1],
        sums[6] + w * n[2],
        sums[7] + w * off,
        sums[8] + w * off * off,
    )


@nb.njit(error_model="numpy")
def _write(out: _Fused, n: int, sums: tuple[float, ...], confirming: int) -> None:
    """The n-th point from its sums over the reference and the maps that confirm it."""
    sw = sums[0]
    length = math.sqrt(sums[4] * sums[4] + sums[5] * sums[5] + sums[6] * sums[6])
    for k in range(3):
        out.xyz[n, k] = sums[1 + k] / sw
        out.normal[n, k] = sums[4 + k] / length
    scatter = max(sums[8] / sw - (sums[7] / sw) ** 2, 0.0)
    # stated noise, or the scatter where that is larger; neighbouring pixels share half their window
    out.sigma[n] = math.sqrt(max(1.0 / sw, scatter / (confirming + 1)))


@nb.njit(cache=True, error_model="numpy")
def _fuse(
    maps: Maps, cameras: Cameras, limits: Agreement, reference: int, partners: Array, taken: Array, out: _Fused
) -> int:
    """Fuses the free pixels of one reference with the maps of its partners; gives the number of points written."""
    h, w = maps.depth.shape[1], maps.depth.shape[2]
    n = 0
    matched = np.empty((len(partners), 3), np.int64)
    for y in range(h):
        for x in range(w):
            if maps.depth[reference, y, x] <= 0.0 or taken[reference, y, x]:
                continue
            weight, point, normal = _seen_first(maps, cameras, reference, x, y)
            sums = _added((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), weight, point, normal, 0.0)
            confirmations = 0
            for v in partners:
                good, i, j, weight, there, partner_normal = _confirmed(
                    maps, cameras, limits, reference, x, y, v, point, normal
                )
                if not good:
                    continue
                a, b, c = there[0] - point[0], there[1] - point[1], there[2] - point[2]
                sums = _added(sums, weight, there, partner_normal, a * normal[0] + b * normal[1] + c * normal[2])
                matched[confirmations, 0], matched[confirmations, 1], matched[confirmations, 2] = v, i, j
                confirmations += 1
            if confirmations < limits.confirming:
                continue
            _write(out, n, sums, confirmations)
            out.pixel[n], out.count[n], out.seen[n, 0] = y * w + x, confirmations + 1, reference
            for k in range(confirmations):
                out.seen[n, k + 1] = matched[k, 0]
                taken[matched[k, 0], matched[k, 1], matched[k, 2]] = True
            taken[reference, y, x] = True
            n += 1
    return n


def fuse(
    maps: Maps,
    cameras: Cameras,
    colour: list[np.ndarray],
    partners: list[np.ndarray],
    view: np.ndarray,
    limits: Agreement = Agreement(),  # noqa: B008
) -> DensePoints:
    """One cloud from all depth maps: each point from a reference pixel and the maps that confirm it.

    Args:
        maps, cameras: of the r references.
        colour: per map (h, w, 3) uint8 BGR.
        partners: per map, the maps it is checked against.
        view: (r,) index of each map's view in the run.
        limits: when maps agree.

    Returns:
        points whose normals are outward (towards the cameras that saw them).
    """
    count, h, w = maps.depth.shape
    taken = np.zeros((count, h, w), np.bool_)
    widest = max((len(p) for p in partners), default=0) + 1
    out = _room(h * w, widest)
    parts = []
    for r in range(count):
        if len(partners[r]) < limits.confirming:
            continue
        n = _fuse(maps, cameras, limits, r, partners[r].astype(np.int64), taken, out)
        rgb = colour[r].reshape(-1, 3)[out.pixel[:n], ::-1].copy()
        member = np.arange(widest) < out.count[:n, None]
        kept = (a[:n].copy() for a in (out.xyz, out.normal, out.sigma, out.count))
        parts.append((*kept, rgb, view[out.seen[:n][member]]))
    if not parts:
        return nothing_measured()
    xyz, normal, sigma, counts, rgb, index = (np.concatenate(part) for part in zip(*parts, strict=True))
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return DensePoints(xyz, normal, rgb, sigma, start, index.astype(np.int32))


def _room(pixels: int, widest: int) -> _Fused:
    points = [np.empty((pixels, 3), np.float32) for _ in range(2)]
    whole = [np.empty(pixels, np.int64) for _ in range(2)]
    seen = np.empty((pixels, widest), np.int32)
    return _Fused(points[0], points[1], np.empty(pixels, np.float32), whole[0], whole[1], seen)
