"""PatchMatch multi-view stereo with slanted planes, on the object's pixels only.

Each pixel of the reference holds a plane (depth, normal in the reference's camera). Planes are judged by a
bilaterally weighted normalised cross-correlation of a 9x9 window (every second pixel) with up to four sources, of
which the best three count; they spread to neighbours in a red-black order and are refined by shrinking random steps
(Bleyer, Rhemann, Rother 2011; Galliani, Lasinger, Schindler 2015). The bilateral weights are taken from both images
(Yoon, Kweon 2006, "Adaptive support-weight approach for correspondence search"): the body turns under a Sun that
stands, so the edge of a shadow lies elsewhere in every frame, and must not be matched. Random numbers are a hash of
pixel, iteration and seed, so the result does not depend on the number of threads.

The two kernels work on a band of rows and release the interpreter; threads are the caller's. What they call is inlined
by numba and not compiled on its own: with separate functions, or with numba's own parallel loops, the machine code that
runs right after compiling is not what a later process loads from the cache, and reordered sums differ in their last
digit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np

Array = np.ndarray

RADIUS, STEP = 4, 2
"""Of the window, and between its pixels [px]."""
SIDE = 2 * RADIUS // STEP + 1
SAMPLES = SIDE * SIDE
_GRID = np.arange(-RADIUS, RADIUS + 1, STEP)
DX = np.tile(_GRID, SIDE).astype(np.float32)
DY = np.repeat(_GRID, SIDE).astype(np.float32)
BEST = 3
"""Sources that count."""
WORST = 2.0
"""Cost of a plane that cannot be judged; 1 - NCC is at most 2."""
ROUNDING = 0.01
"""Room for rounding, by which a cost that ends below 0 could be better than what is known of it."""
LEAST_WEIGHT = 0.2
"""Share of a window that must look like its middle in both images."""
SIDES = np.array([-1.0, 0.0, 1.0, -8.0, -4.0, 4.0, 8.0])
"""Half pixels of parallax at which a depth is judged last: about it, and elsewhere."""
UNIQUE = 0.25
"""Least excess of the cost two and four pixels of parallax away, over the cost. Of depths of a rendered plain jug and of a printed box
with less than 0.1, 64 to 75 % and 50 % were wrong by more than a pixel, most of them too deep; with 0.3, 46 and 29 %; above 1,
15 to 26 % and 1 to 4 %. What is said less clearly is wrong too often to outvote silhouettes: 69 and 55 % of what was wrong
goes, and 35 and 9 % of what was right. Two pixels alone find 65 and 52 % of it, six places 70 and 57 %."""

Plane = tuple[float, float, float, float]
"""Depth at the pixel and normal."""
Ray = tuple[float, float, float, float]
"""1/fu, -cu/fu, 1/fv, -cv/fv: from a pixel to its ray."""
Camera = tuple[float, ...]
"""The 16 numbers of a source's camera, see `Sources`."""
Warp = tuple[bool, float, float, float, float, float, float, float, float, float, float]
"""What `_warp` gives."""


class Reference(NamedTuple):
    """The view whose depths are sought: image (h, w) float32 grey; mask (h, w) uint8, 0 off the object, 1 on it, 2 and
    above where a depth is wanted."""

    image: np.ndarray
    mask: np.ndarray


class Sources(NamedTuple):
    """The views that it is matched with: images (s * rows * columns,) as `paired` makes them, one after the other; cameras
    (s, 16) fu fv cu cv, and the rotation, row by row, and translation from the reference's camera to the source's."""

    images: np.ndarray
    cameras: np.ndarray


class Frame(NamedTuple):
    """Numbers that hold for every pixel; no arrays, since passing one on counts its references, pixel by pixel.

    Attributes:
        ray: of the reference.
        rows, columns: of each source.
        level_sigma: grey-level width of the bilateral weight.
        least_variance: below it there is no texture.
        unique: least excess of the cost elsewhere, over the cost; 0 or below asks for none.
    """

    ray: Ray
    rows: int
    columns: int
    level_sigma: float
    least_variance: float
    unique: float


class Planes(NamedTuple):
    """The state: depth (h, w), normal (h, w, 3), cost (h, w), float32; a cost below 0 means not judged yet."""

    depth: np.ndarray
    normal: np.ndarray
    cost: np.ndarray


class Steps(NamedTuple):
    """How one iteration looks for better planes.

    Attributes:
        near, far: range of depths.
        iteration, seed: of the random steps.
        scale: relative size of the first of them.
        tries: random steps per pixel.
        reach: farthest neighbour asked.
    """

    near: float
    far: float
    iteration: int
    seed: int
    scale: float
    tries: int
    reach: int


@nb.njit(inline="always")
def _hash(a: int, b: int, c: int, d: int) -> float:
    """Uniform in [-1, 1) from four integers."""
    h = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(b) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= np.uint64(c) * np.uint64(0x165667B19E3779F9) + np.uint64(d) * np.uint64(0x27D4EB2F165667C5)
    h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(32)
    h *= np.uint64(0x94D049BB133111EB)
    h ^= h >> np.uint64(29)
    return float(h >> np.uint64(11)) * (2.0 / 9007199254740992.0) - 1.0


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _window(image: Array, mask: Array, x: int, y: int, window: Array, level_sigma: float) -> tuple[float, float]:
    """Bilateral weights and values of the reference's window, its first two rows (3, SAMPLES); its weighted variance, or -1
    when there is no texture, and mean."""
    h, w = image.shape
    centre = image[y, x]
    total, s1, s2 = 0.0, 0.0, 0.0
    k = 0
    for dy in range(-RADIUS, RADIUS + 1, STEP):
        for dx in range(-RADIUS, RADIUS + 1, STEP):
            i, j = y + dy, x + dx
            if i < 0 or j < 0 or i >= h or j >= w or mask[i, j] == 0:
                window[0, k] = 0.0
                window[1, k] = 0.0
            else:
                v = image[i, j]
                difference = (v - centre) / level_sigma
                wt = math.exp(-0.5 * difference * difference - (dx * dx + dy * dy) / 50.0)
                window[0, k] = wt
                window[1, k] = v
                total += wt
                s1 += wt * v
                s2 += wt * v * v
            k += 1
    if total <= 0.0:
        return -1.0, 0.0
    mean = s1 / total
    for k in range(SAMPLES):
        window[0, k] /= total
    return s2 / total - mean * mean, mean


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _bend_window(window: Array, bent: Array, d: float) -> float:
    """The window's third row: what a surface that bends adds to the plane's inverse depth at each sample. `bent`: the three
    relative second derivatives of the inverse depth. Gives the largest."""
    xx, xy, yy = bent[0] / d, bent[1] / d, bent[2] / d
    most = 0.0
    for k in range(SAMPLES):
        dx, dy = DX[k], DY[k]
        v = 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
        window[2, k] = v
        most = max(most, abs(v))
    return most


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _warp(x: int, y: int, plane: Plane, bulge: float, camera: Camera, frame: Frame) -> Warp:
    """The plane's homography about the pixel: numerators and denominator, linear in the offset (dx, dy) from it.

    H = K_s (R + t n^T / offset) K^-1. Gives whether the whole window falls inside the source, the numerators of u and
    of v (1, dx, dy), the denominator's factors of dx and dy, of which the constant is 1, and how far u and v move for a
    unit of inverse depth. `bulge`: the largest inverse depth that the window bends by.
    """
    d, n0, n1, n2 = plane
    ray = frame.ray
    nothing = (False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rx, ry = ray[0] * x + ray[1], ray[2] * y + ray[3]
    offset = d * (n0 * rx + n1 * ry + n2)
    if abs(offset) < 1e-12:
        return nothing
    a0, a1, a2 = n0 / offset, n1 / offset, n2 / offset
    m00, m01, m02 = camera[4] + camera[13] * a0, camera[5] + camera[13] * a1, camera[6] + camera[13] * a2
    m10, m11, m12 = camera[7] + camera[14] * a0, camera[8] + camera[14] * a1, camera[9] + camera[14] * a2
    m20, m21, m22 = camera[10] + camera[15] * a0, camera[11] + camera[15] * a1, camera[12] + camera[15] * a2
    c0, c1, c2 = m20 * rx + m21 * ry + m22, m20 * ray[0], m21 * ray[2]
    if c0 - RADIUS * (abs(c1) + abs(c2)) <= 1e-6 * c0:
        return nothing
    scale = 1.0 / c0
    U, V = m00 * rx + m01 * ry + m02, m10 * rx + m11 * ry + m12
    by_u = camera[0] * (camera[13] - U * scale * camera[15]) * scale
    by_v = camera[1] * (camera[14] - V * scale * camera[15]) * scale
    beyond_u, beyond_v = bulge * abs(by_u), bulge * abs(by_v)
    u0 = (camera[0] * U + camera[2] * c0) * scale
    u1, u2 = (camera[0] * m00 * ray[0] + camera[2] * c1) * scale, (camera[0] * m01 * ray[2] + camera[2] * c2) * scale
    v0 = (camera[1] * V + camera[3] * c0) * scale
    v1, v2 = (camera[1] * m10 * ray[0] + camera[3] * c1) * scale, (camera[1] * m11 * ray[2] + camera[3] * c2) * scale
    c1, c2 = c1 * scale, c2 * scale
    # the window is convex and so is its image: its corners decide whether all of it is inside
    for corner in range(4):
        dx = RADIUS if corner & 1 else -RADIUS
        dy = RADIUS if corner & 2 else -RADIUS
        e = 1.0 + c1 * dx + c2 * dy  # above 0
        u, v = u0 + u1 * dx + u2 * dy, v0 + v1 * dx + v2 * dy
        if not (u >= beyond_u * e and u < (frame.columns - 1.01 - beyond_u) * e):
            return nothing
        if not (v >= beyond_v * e and v < (frame.rows - 1.01 - beyond_v) * e):
            return nothing
    return True, u0, u1, u2, v0, v1, v2, c1, c2, by_u, by_v


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _camera(cameras: Array, s: int) -> Camera:
    """One row of the sources' cameras as numbers."""
    c = cameras[s]
    return (c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12], c[13], c[14], c[15])


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _bilinear(images: Array, first: np.uint32, columns: int, u: np.floating, v: np.floating) -> np.floating:
    """The value between four pixels of the image that begins at `first` of those that `paired` gives; u, v float32."""
    j, i = np.int32(u), np.int32(v)
    fu, fv = u - np.float32(j), v - np.float32(i)
    at = first + np.uint32(i * columns + j)
    upper, lower = images[at], images[at + np.uint32(columns)]
    top, low = np.int32(upper).view(np.float32), np.int32(lower).view(np.float32)
    top += fu * (np.int32(upper >> 32).view(np.float32) - top)
    low += fu * (np.int32(lower >> 32).view(np.float32) - low)
    out: np.floating = top + fv * (low - top)
    return out


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _sums(
    warp: Warp, window: Array, mean: float, images: Array, first: np.uint32, frame: Frame
) -> tuple[np.floating, np.floating, np.floating, np.floating, np.floating, np.floating]:
    """Sums over the window warped into the image that begins at `first`, weighted by the likeness to the middle in both: of the
    weights; of the reference's values and their squares; of the source's; of their products."""
    _, u0, u1, u2, v0, v1, v2, c1, c2, by_u, by_v = warp
    fu0, fu1, fu2 = np.float32(u0), np.float32(u1), np.float32(u2)
    fv0, fv1, fv2 = np.float32(v0), np.float32(v1), np.float32(v2)
    fc1, fc2, one = np.float32(c1), np.float32(c2), np.float32(1.0)
    bu, bv = np.float32(by_u), np.float32(by_v)
    s1, s2, cross = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    total, o1, o2 = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    centre = _bilinear(images, first, frame.columns, fu0, fv0)
    sharp = np.float32(0.5 / (frame.level_sigma * frame.level_sigma))
    for k in range(SAMPLES):
        dx, dy = DX[k], DY[k]
        e = one / (one + fc1 * dx + fc2 * dy)
        b = window[2, k]
        at_u, at_v = (fu0 + fu1 * dx + fu2 * dy) * e + bu * b, (fv0 + fv1 * dx + fv2 * dy) * e + bv * b
        v = _bilinear(images, first, frame.columns, at_u, at_v) - centre
        q = one / (one + v * v * sharp)
        ws = window[0, k] * q * q
        r = window[1, k] - np.float32(mean)
        total += ws
        o1 += ws * r
        o2 += ws * r * r
        s1 += ws * v
        s2 += ws * v * v
        cross += ws * v * r
    return total, o1, o2, s1, s2, cross


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _ncc_cost(
    total: np.floating, o1: np.floating, o2: np.floating, s1: np.floating, s2: np.floating, cross: np.floating
) -> float | np.floating:
    """1 - NCC by the sums over a window."""
    if total < LEAST_WEIGHT:
        return WORST
    s1, s2, o1, o2, cross = s1 / total, s2 / total, o1 / total, o2 / total, cross / total
    spread, reference_spread = s2 - s1 * s1, o2 - o1 * o1
    if spread < 0.05 or reference_spread < 0.05:
        return WORST
    return 1.0 - (cross - s1 * o1) / math.sqrt(spread * reference_spread)


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _cost(
    x: int,
    y: int,
    plane: Plane,
    bulge: float,
    window: Array,
    mean: float,
    sources: Sources,
    each: Array,
    frame: Frame,
    limit: float,
) -> float:
    """Mean of the best BEST sources' costs, or WORST as soon as it is sure to be above `limit`; each (s,) is room for them."""
    images, cameras = sources
    count = len(cameras)
    best = min(BEST, count)
    total, most, worse = 0.0, 0.0, False
    for s in range(count):
        each[s] = WORST
        warp = _warp(x, y, plane, bulge, _camera(cameras, s), frame)
        if warp[0]:
            total_, o1, o2, s1, s2, cross = _sums(
                warp, window, mean, images, np.uint32(s * frame.rows * frame.columns), frame
            )
            each[s] = _ncc_cost(total_, o1, o2, s1, s2, cross)
        total += each[s]
        most = max(most, each[s])
        worse = total - (count - best) * most > best * (limit + ROUNDING)  # what is not counted is at most the worst
        if worse:
            break
    total = WORST * best if worse else 0.0
    for _ in range(0 if worse else best):
        low, at = 9.0, 0
        for s in range(count):
            if each[s] < low:
                low, at = each[s], s
        total += low
        each[at] = 9.0
    return total / best


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _beside(x: int, y: int, k: int) -> tuple[int, int]:
    """Row and column of the k-th neighbour of a pixel."""
    away = 1 + 2 * (k // 4)
    i, j = y, x
    if k % 4 == 0:
        j = x - away
    elif k % 4 == 1:
        j = x + away
    elif k % 4 == 2:
        i = y - away
    else:
        i = y + away
    return i, j


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _neighbour(
    x: int, y: int, i: int, j: int, plane: Plane, other: Plane, ray: Ray, steps: Steps
) -> tuple[bool, float, float, float, float]:
    """The plane of the neighbour (i, j) at the pixel: whether it is worth judging, depth there, normal."""
    d, n0, n1, n2 = plane
    nothing = (False, 0.0, 0.0, 0.0, 0.0)
    away, m0, m1, m2 = other
    if away <= 0.0:
        return nothing
    rx, ry = ray[0] * x + ray[1], ray[2] * y + ray[3]
    slope = m0 * rx + m1 * ry + m2
    if slope > -0.05:
        return nothing
    jx, jy = ray[0] * j + ray[1], ray[2] * i + ray[3]
    e = away * (m0 * jx + m1 * jy + m2) / slope
    if e < steps.near or e > steps.far:
        return nothing
    if abs(e - d) < 3e-5 * d and m0 * n0 + m1 * n1 + m2 * n2 > 0.9995:
        return nothing  # the same plane to a small part of a pixel
    return True, e, m0, m1, m2


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _random_step(
    x: int, y: int, pixel: int, t: int, plane: Plane, size: float, colour: int, ray: Ray, steps: Steps
) -> tuple[bool, float, float, float, float]:
    """The plane after the t-th random step, of this relative size, as `_neighbour` gives it."""
    d, n0, n1, n2 = plane
    draw = steps.iteration * 64 + t * 4
    a = _hash(pixel, draw, colour, steps.seed)
    e = d + a * size * (steps.far - steps.near)
    m0 = n0 + size * 3.0 * _hash(pixel, draw + 1, colour, steps.seed)
    m1 = n1 + size * 3.0 * _hash(pixel, draw + 2, colour, steps.seed)
    m2 = n2 + size * 3.0 * _hash(pixel, draw + 3, colour, steps.seed)
    if t % 3 == 1:
        m0, m1, m2 = n0, n1, n2
    elif t % 3 == 2:
        e = d
    length = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2) + 1e-12
    m0, m1, m2 = m0 / length, m1 / length, m2 / length
    rx, ry = ray[0] * x + ray[1], ray[2] * y + ray[3]
    if m0 * rx + m1 * ry + m2 > -0.05 or e < steps.near or e > steps.far:
        return False, 0.0, 0.0, 0.0, 0.0
    return True, e, m0, m1, m2


@nb.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def sweep(
    reference: Reference,
    planes: Planes,
    sources: Sources,
    frame: Frame,
    steps: Steps,
    colour: int,
    first: int,
    last: int,
) -> None:
    """One half of a red-black iteration, in place.

    Args:
        reference, planes, sources, frame, steps: what is matched, its state, with what, and how.
        colour: 0 or 1: which half.
        first, last: rows to work on, [first, last).
    """
    (image, mask), (depth, normal, cost), cameras = reference, planes, sources.cameras
    h, w = mask.shape
    window, each = np.zeros((3, SAMPLES), np.float32), np.empty(len(cameras), np.float64)
    near_ones = 4 * steps.reach
    for y in range(first, last):
        for x in range((y + colour) % 2, w, 2):
            if mask[y, x] < 2:
                continue
            variance, mean = _window(image, mask, x, y, window, frame.level_sigma)
            if variance < frame.least_variance:
                cost[y, x] = WORST
                continue
            d, n0, n1, n2, c = depth[y, x], normal[y, x, 0], normal[y, x, 1], normal[y, x, 2], cost[y, x]
            size = steps.scale
            # the plane itself when it is not judged yet, those of neighbours, random steps: judged in one place, since
            # every call is compiled on its own
            for k in range(-1, near_ones + steps.tries):
                plane = (d, n0, n1, n2)
                if k < 0:
                    good, e, m0, m1, m2 = c < 0.0, d, n0, n1, n2
                elif k < near_ones:
                    i, j = _beside(x, y, k)
                    if i < 0 or j < 0 or i >= h or j >= w or mask[i, j] == 0:
                        continue
                    other = (depth[i, j], normal[i, j, 0], normal[i, j, 1], normal[i, j, 2])
                    good, e, m0, m1, m2 = _neighbour(x, y, i, j, plane, other, frame.ray, steps)
                else:
                    good, e, m0, m1, m2 = _random_step(
                        x, y, y * w + x, k - near_ones, plane, size, colour, frame.ray, steps
                    )
                if not good:
                    continue
                if k >= near_ones:
                    size *= 0.6
                g = _cost(x, y, (e, m0, m1, m2), 0.0, window, mean, sources, each, frame, 9.0 if k < 0 else c)
                if k < 0 or g < c:
                    d, n0, n1, n2, c = e, m0, m1, m2, g
            depth[y, x], cost[y, x] = d, c
            normal[y, x, 0], normal[y, x, 1], normal[y, x, 2] = n0, n1, n2


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _parallax(x: int, y: int, d: float, cameras: Array, ray: Ray) -> float:
    """Root mean square of the pixels by which a source's image moves for a unit of depth."""
    rx, ry = ray[0] * x + ray[1], ray[2] * y + ray[3]
    parallax = 0.0
    for s in range(len(cameras)):
        X = d * (cameras[s, 4] * rx + cameras[s, 5] * ry + cameras[s, 6]) + cameras[s, 13]
        Y = d * (cameras[s, 7] * rx + cameras[s, 8] * ry + cameras[s, 9]) + cameras[s, 14]
        Z = d * (cameras[s, 10] * rx + cameras[s, 11] * ry + cameras[s, 12]) + cameras[s, 15]
        dX = cameras[s, 4] * rx + cameras[s, 5] * ry + cameras[s, 6]
        dY = cameras[s, 7] * rx + cameras[s, 8] * ry + cameras[s, 9]
        dZ = cameras[s, 10] * rx + cameras[s, 11] * ry + cameras[s, 12]
        if Z <= 1e-9:
            continue
        du = cameras[s, 0] * (dX * Z - X * dZ) / (Z * Z)
        dv = cameras[s, 1] * (dY * Z - Y * dZ) / (Z * Z)
        parallax += du * du + dv * dv
    return math.sqrt(parallax / len(cameras)) + 1e-12


@nb.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def polish(
    reference: Reference,
    planes: Planes,
    bent: Array,
    sources: Sources,
    frame: Frame,
    sigma: Array,
    noise_px: float,
    first: int,
    last: int,
) -> None:
    """Last step in depth by a parabola through the cost at half a pixel of parallax either side, and its 1-sigma. Depths that fit
    as well elsewhere go.

    Arguments as of `sweep`; windows bend by `bent` (h, w, 3), see `curvature.py`; `sigma` (h, w) float32 is written: one sigma of the depth along the line of sight, from the
    parallax per depth of the sources and `noise_px`, widened where the cost is high or flat.
    """
    (image, mask), (depth, normal, cost), cameras = reference, planes, sources.cameras
    h, w = mask.shape
    window, each = np.zeros((3, SAMPLES), np.float32), np.empty(len(cameras), np.float64)
    for y in range(first, last):
        for x in range(w):
            sigma[y, x] = 0.0
            if mask[y, x] < 2 or cost[y, x] >= WORST or cost[y, x] < 0.0:
                continue
            variance, mean = _window(image, mask, x, y, window, frame.level_sigma)
            if variance < frame.least_variance:
                cost[y, x] = WORST
                continue
            d, n0, n1, n2 = depth[y, x], normal[y, x, 0], normal[y, x, 1], normal[y, x, 2]
            parallax = _parallax(x, y, d, cameras, frame.ray)
            step = 0.5 / parallax
            bulge = _bend_window(window, bent[y, x], d)
            low, c, high, elsewhere = 0.0, 0.0, 0.0, WORST
            # elsewhere only where it is asked for; one call: each is compiled on its own
            for k in range(len(SIDES) if frame.unique > 0.0 else 3):
                plane = (d + SIDES[k] * step, n0, n1, n2)
                limit = 9.0 if k < 3 else c + frame.unique * c
                g = _cost(x, y, plane, bulge, window, mean, sources, each, frame, limit)
                if k == 0:
                    low = g
                elif k == 1:
                    c = g
                elif k == 2:
                    high = g
                else:
                    elsewhere = min(elsewhere, g)
            if frame.unique > 0.0 and elsewhere - c < frame.unique * c:
                cost[y, x] = WORST
                continue
            curvature = low + high - 2.0 * c
            if curvature > 1e-4 and low < WORST and high < WORST:
                move = 0.5 * (low - high) / curvature
                depth[y, x] = d + step * min(max(move, -1.0), 1.0)
                flat = min(max(0.05 / curvature, 1.0), 9.0)
            else:
                flat = 9.0
            sigma[y, x] = noise_px / parallax * math.sqrt(flat) * (1.0 + 2.0 * c)


def paired(images: np.ndarray) -> np.ndarray:
    """Float32 images (s, h, w) as int64 (s * h * w,): the lower half of each is a pixel, the upper half the next one of its row, so
    that one look-up gives both."""
    pairs = np.zeros((*images.shape, 2), np.float32)
    pairs[..., 0] = images
    pairs[..., :-1, 1] = images[..., 1:]
    return pairs.view(np.int64).ravel()


def grey_pyramid_half(image: np.ndarray) -> np.ndarray:
    """The image (h, w) at half its size by area, (h // 2, w // 2)."""
    h, w = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    upper, lower = image[:h:2, :w], image[1:h:2, :w]
    four = (upper[:, ::2] + upper[:, 1::2]) + (lower[:, ::2] + lower[:, 1::2])
    return np.asarray(four / np.float32(4))
