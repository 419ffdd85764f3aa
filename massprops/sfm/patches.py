"""Where a small piece of surface is seen again, to a fraction of a pixel.

The piece is a plane through a surface point. Its picture in one view is warped into another by that plane, so that it may be
followed through changes of direction that no descriptor bears, and through the whole footage. What is left is a shift in the second
image (Lucas and Kanade 1981), with gain and offset of brightness left free. Pixels have bilateral weights in both images, since the
edges of shadows stay with the Sun and not with the body.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np

Array = np.ndarray

RADIUS = 4
SIDE = 2 * RADIUS + 1
MIDDLE = SIDE * SIDE // 2
ROUNDS = 10
FARTHEST = 3.0
"""Longest shift [px]: the poses are known to better than this."""


class Pictures(NamedTuple):
    """grey: (n, h, w) uint8; mask: (n, h, w) uint8, 0 off the object; size: (n, 2) width and height of each; K: (n, 4) fu
    fv cu cv."""

    grey: np.ndarray
    mask: np.ndarray
    size: np.ndarray
    K: np.ndarray


@nb.njit(cache=True, error_model="numpy")
def _sample(image: Array, us: Array, vs: Array, du: float, dv: float, out: Array) -> None:
    """Values and derivatives (3, s) of an image at (us + du, vs + dv), by Catmull and Rom's cubic."""
    for s in range(len(us)):
        u, v = us[s] + du, vs[s] + dv
        j, i = int(math.floor(u)), int(math.floor(v))
        f, g = u - j, v - i
        value, along_u, along_v = 0.0, 0.0, 0.0
        p = (((-0.5 * g + 1.0) * g - 0.5) * g, (1.5 * g - 2.5) * g * g + 1.0,
             ((-1.5 * g + 2.0) * g + 0.5) * g, (0.5 * g - 0.5) * g * g)  # fmt: skip
        d = ((-1.5 * g + 2.0) * g - 0.5, (4.5 * g - 5.0) * g, (-4.5 * g + 4.0) * g + 0.5, (1.5 * g - 1.0) * g)
        for a in range(4):
            row = i + a - 1
            q0, q1 = float(image[row, j - 1]), float(image[row, j])
            q2, q3 = float(image[row, j + 1]), float(image[row, j + 2])
            b3, b2, b1 = 0.5 * (q3 - q0) + 1.5 * (q1 - q2), q0 - 2.5 * q1 + 2.0 * q2 - 0.5 * q3, 0.5 * (q2 - q0)
            across = ((b3 * f + b2) * f + b1) * f + q1
            value += p[a] * across
            along_u += p[a] * ((3.0 * b3 * f + 2.0 * b2) * f + b1)
            along_v += d[a] * across
        out[0, s], out[1, s], out[2, s] = value, along_u, along_v


@nb.njit(cache=True, error_model="numpy")
def _warped(
    pictures: Pictures,
    a: int,
    b: int,
    plane: tuple[Array, Array],
    to_second: tuple[Array, Array],
    sharp: float,
    work: Array,
) -> bool:
    """Whether the piece lies in view a and, by the poses, in view b; writes into `work` its pixels there, their weights and
    what a shows of it."""
    c, n = plane
    turn, move = to_second
    K, size, K2, size2 = pictures.K[a], pictures.size[a], pictures.K[b], pictures.size[b]
    mask = pictures.mask[a]
    u0, v0 = K[0] * c[0] / c[2] + K[2], K[1] * c[1] / c[2] + K[3]
    edge = RADIUS + 2
    if not (u0 > edge and v0 > edge and u0 < size[0] - 1 - edge and v0 < size[1] - 1 - edge):
        return False
    offset = n[0] * c[0] + n[1] * c[1] + n[2] * c[2]
    margin = FARTHEST + 2
    us, vs, weight, in_first = work[0], work[1], work[2], work[3:6]
    for k in range(SIDE * SIDE):
        us[k], vs[k] = u0 + k % SIDE - RADIUS, v0 + k // SIDE - RADIUS
    _sample(pictures.grey[a], us, vs, 0.0, 0.0, in_first)
    value = in_first[0]
    for k in range(SIDE * SIDE):
        likeness = (value[k] - value[MIDDLE]) * sharp
        dx, dy = us[k] - u0, vs[k] - v0
        weight[k] = math.exp(-(dx * dx + dy * dy) / (1.0 * RADIUS * RADIUS)) / (1.0 + likeness * likeness)
        if mask[int(round(vs[k])), int(round(us[k]))] == 0:
            weight[k] = 0.0
        x, y = (us[k] - K[2]) / K[0], (vs[k] - K[3]) / K[1]
        depth = offset / (n[0] * x + n[1] * y + n[2])
        e = depth * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]) + move[0]
        f = depth * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]) + move[1]
        d = depth * (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]) + move[2]
        if not (depth > 0 and d > 0):
            return False
        us[k], vs[k] = K2[0] * e / d + K2[2], K2[1] * f / d + K2[3]
        if not (us[k] > margin and vs[k] > margin and us[k] < size2[0] - 1 - margin and vs[k] < size2[1] - 1 - margin):
            return False
    return True


@nb.njit(cache=True, error_model="numpy")
def _shift(weight: Array, own: Array, there: Array, sharp: float) -> tuple[float, float, float]:
    """Step (u, v) in the second image that brings `there` (3, s), value and derivatives, closer to `own`'s value, and the
    correlation before it; -1 where they are not alike or the piece has no texture."""
    value = own[0]
    total, s1, s2, gx, gy = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(SIDE * SIDE):
        likeness = (there[0, k] - there[0, MIDDLE]) * sharp
        w = weight[k] / (1.0 + likeness * likeness)
        own[1, k] = w
        total += w
        s1 += w * value[k]
        s2 += w * there[0, k]
        gx += w * there[1, k]
        gy += w * there[2, k]
    s1, s2, gx, gy = s1 / total, s2 / total, gx / total, gy / total
    # sums of the brightness here (a), there (b), and of the residual with its slopes
    aa, bb, ab, ax, ay, bx, by, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(SIDE * SIDE):
        w, a, b, x, y = own[1, k], value[k] - s1, there[0, k] - s2, there[1, k] - gx, there[2, k] - gy
        aa += w * a * a
        bb += w * b * b
        ab += w * a * b
        ax += w * a * x
        ay += w * a * y
        bx += w * b * x
        by += w * b * y
        xx += w * x * x
        xy += w * x * y
        yy += w * y * y
    det = xx * yy - xy * xy
    if not (ab > 0 and det > 1e-9 * (xx + yy) * (xx + yy)):
        return 0.0, 0.0, -1.0
    gain = ab / aa
    rx, ry = gain * ax - bx, gain * ay - by
    return (yy * rx - xy * ry) / det, (xx * ry - xy * rx) / det, ab / math.sqrt(aa * bb)


@nb.njit(cache=True, error_model="numpy")
def _one(
    pictures: Pictures,
    a: int,
    b: int,
    plane: tuple[Array, Array],
    to_second: tuple[Array, Array],
    sharp: float,
    work: Array,
    out: Array,
) -> None:
    """Place and correlation (3,) of one piece of view a in view b; a correlation of -1 where it could not be followed.

    plane: (3,) its place and (3,) its normal in a's camera; to_second: turn (3, 3) and move (3,) from there to b's.
    """
    if not _warped(pictures, a, b, plane, to_second, sharp, work):
        return
    us, vs, weight, in_first, there = work[0], work[1], work[2], work[3:6], work[6:9]
    du, dv, alike = 0.0, 0.0, -1.0
    for _ in range(ROUNDS):
        _sample(pictures.grey[b], us, vs, du, dv, there)
        sx, sy, alike = _shift(weight, in_first, there, sharp)
        if alike < 0:
            return
        step = math.sqrt(sx * sx + sy * sy)
        if step > 1.0:
            sx, sy = sx / step, sy / step
        du += sx
        dv += sy
        if du * du + dv * dv > FARTHEST * FARTHEST:
            return
        if step < 0.01:
            break
    out[0], out[1], out[2] = us[MIDDLE] + du, vs[MIDDLE] + dv, alike


@nb.njit(cache=True, error_model="numpy")
def _all(
    home: Array,
    view: Array,
    planes: tuple[Array, Array],
    to_second: tuple[Array, Array],
    pictures: Pictures,
    sharp: float,
    out: Array,
) -> None:
    work = np.empty((9, SIDE * SIDE))
    c, n = planes
    turn, move = to_second
    for i in range(len(home)):
        _one(pictures, home[i], view[i], (c[i], n[i]), (turn[i], move[i]), sharp, work, out[i])


def follow(
    point: np.ndarray,
    home: np.ndarray,
    view: np.ndarray,
    pieces: tuple[np.ndarray, np.ndarray],
    poses: tuple[np.ndarray, np.ndarray],
    pictures: Pictures,
    sharp: float,
) -> np.ndarray:
    """Where pieces of surface are seen.

    Args:
        point, home, view: (k,) int64: piece, the view that shows it best, and the view it is looked for in.
        pieces: (m, 3) xyz and (m, 3) normals, in the world.
        poses: (n, 3, 3) and (n, 3) world to camera.
        sharp: one over the grey-level width of the bilateral weights.

    Returns:
        (k, 3) u, v [px] and the normalised correlation, -1 where the piece was not found.
    """
    (xyz, normal), (R, t) = pieces, poses
    c = np.einsum("kij,kj->ki", R[home], xyz[point]) + t[home]
    n = np.einsum("kij,kj->ki", R[home], normal[point])
    turn = np.einsum("kij,klj->kil", R[view], R[home])
    move = t[view] - np.einsum("kij,kj->ki", turn, t[home])
    out = np.tile([0.0, 0.0, -1.0], (len(point), 1))
    _all(home, view, (c, n), (turn, move), pictures, sharp, out)
    return out


@nb.njit(cache=True, error_model="numpy")
def nearest_depth(xyz: Array, K: Array, R: Array, t: Array, factor: float, h: int, w: int) -> Array:
    """(h, w) least depth of points (m, 3) drawn 3 pixels wide into a view reduced by `factor`; inf where none is."""
    out = np.full((h, w), np.inf)
    for p in range(len(xyz)):
        x, y, z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
        d = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2]
        if d <= 0:
            continue
        u = factor * (K[0] * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0]) / d + K[2])
        v = factor * (K[1] * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1]) / d + K[3])
        j, i = int(math.floor(u)), int(math.floor(v))
        for a in range(max(0, i - 1), min(h, i + 2)):
            for b in range(max(0, j - 1), min(w, j + 2)):
                out[a, b] = min(out[a, b], d)
    return out
