"""PatchMatch multi-view stereo with slanted planes, on the object's pixels only.

Each pixel of the reference holds a plane (depth, normal in the reference's camera). Planes are judged by a
bilaterally weighted normalised cross-correlation of an 9x9 window (every second pixel) with up to four sources, of
which the best three count; they spread to neighbours in a red-black order and are refined by shrinking random steps
(Bleyer, Rhemann, Rother 2011; Galliani, Lasinger, Schindler 2015). The bilateral weights are taken from both images
(Yoon, Kweon 2006, "Adaptive support-weight approach for correspondence search"): the body turns under a Sun that
stands, so the edge of a shadow lies elsewhere in every frame, and must not be matched. Random numbers are a hash of pixel, iteration and
seed, so the result does not depend on the number of threads.

The two kernels work on a band of rows and release the interpreter; threads are the caller's. What they call is inlined
by numba and not compiled on its own: with separate functions, or with numba's own parallel loops, the machine code that
runs right after compiling is not what a later process loads from the cache, and reordered sums differ in their last
digit.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

RADIUS, STEP = 4, 2
SIDE = 2 * RADIUS // STEP + 1
SAMPLES = SIDE * SIDE
_GRID = np.arange(-RADIUS, RADIUS + 1, STEP)
DX = np.tile(_GRID, SIDE).astype(np.float32)
DY = np.repeat(_GRID, SIDE).astype(np.float32)
BEST = 3
WORST = 2.0
"""Cost of a plane that cannot be judged; 1 - NCC is at most 2."""
LEAST_WEIGHT = 0.2
"""Share of a window that must look like its middle in both images."""


@nb.njit(inline="always")
def _hash(a, b, c, d):  # type: ignore[no-untyped-def]
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
def _window(image, mask, x, y, weight, value, level_sigma):  # type: ignore[no-untyped-def]
    """Bilateral weights and values of the reference's window; the weighted variance, or -1 when there is no texture."""
    h, w = image.shape
    centre = image[y, x]
    total, s1, s2 = 0.0, 0.0, 0.0
    k = 0
    for dy in range(-RADIUS, RADIUS + 1, STEP):
        for dx in range(-RADIUS, RADIUS + 1, STEP):
            i, j = y + dy, x + dx
            if i < 0 or j < 0 or i >= h or j >= w or mask[i, j] == 0:
                weight[k] = 0.0
                value[k] = 0.0
            else:
                v = image[i, j]
                difference = (v - centre) / level_sigma
                wt = math.exp(-0.5 * difference * difference - (dx * dx + dy * dy) / 50.0)
                weight[k] = wt
                value[k] = v
                total += wt
                s1 += wt * v
                s2 += wt * v * v
            k += 1
    if total <= 0.0:
        return -1.0, 0.0
    mean = s1 / total
    for k in range(SAMPLES):
        weight[k] /= total
    return s2 / total - mean * mean, mean


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _ncc_cost(x, y, d, n0, n1, n2, weight, value, mean, inverse, source, h, w, K_s, R_s, t_s, level_sigma):  # type: ignore[no-untyped-def]
    """1 - NCC of the window warped by the plane into one source image, given flat, weighted by the likeness to the
    middle in both."""
    rx, ry = inverse[0] * x + inverse[1], inverse[2] * y + inverse[3]
    offset = d * (n0 * rx + n1 * ry + n2)
    if abs(offset) < 1e-12:
        return WORST
    # H = K_s (R + t n^T / offset) K^-1; numerators and denominator are linear in the offset (dx, dy) from the pixel
    a0, a1, a2 = n0 / offset, n1 / offset, n2 / offset
    m00, m01, m02 = R_s[0, 0] + t_s[0] * a0, R_s[0, 1] + t_s[0] * a1, R_s[0, 2] + t_s[0] * a2
    m10, m11, m12 = R_s[1, 0] + t_s[1] * a0, R_s[1, 1] + t_s[1] * a1, R_s[1, 2] + t_s[1] * a2
    m20, m21, m22 = R_s[2, 0] + t_s[2] * a0, R_s[2, 1] + t_s[2] * a1, R_s[2, 2] + t_s[2] * a2
    c0, c1, c2 = m20 * rx + m21 * ry + m22, m20 * inverse[0], m21 * inverse[2]
    if c0 - RADIUS * (abs(c1) + abs(c2)) <= 1e-6 * c0:
        return WORST
    scale = 1.0 / c0
    u0 = (K_s[0] * (m00 * rx + m01 * ry + m02) + K_s[2] * c0) * scale
    u1, u2 = (K_s[0] * m00 * inverse[0] + K_s[2] * c1) * scale, (K_s[0] * m01 * inverse[2] + K_s[2] * c2) * scale
    v0 = (K_s[1] * (m10 * rx + m11 * ry + m12) + K_s[3] * c0) * scale
    v1, v2 = (K_s[1] * m10 * inverse[0] + K_s[3] * c1) * scale, (K_s[1] * m11 * inverse[2] + K_s[3] * c2) * scale
    c1, c2 = c1 * scale, c2 * scale
    # the window is convex and so is its image: its corners decide whether all of it is inside
    for corner in range(4):
        dx = RADIUS if corner & 1 else -RADIUS
        dy = RADIUS if corner & 2 else -RADIUS
        e = 1.0 + c1 * dx + c2 * dy
        u, v = (u0 + u1 * dx + u2 * dy) / e, (v0 + v1 * dx + v2 * dy) / e
        if not (u >= 0.0 and v >= 0.0 and u < w - 1.01 and v < h - 1.01):
            return WORST
    fu0, fu1, fu2 = np.float32(u0), np.float32(u1), np.float32(u2)
    fv0, fv1, fv2 = np.float32(v0), np.float32(v1), np.float32(v2)
    fc1, fc2, one = np.float32(c1), np.float32(c2), np.float32(1.0)
    s1, s2, cross = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    total, v1, v2 = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    j, i = np.int32(fu0), np.int32(fv0)
    fu, fv = fu0 - np.float32(j), fv0 - np.float32(i)
    at = np.uint32(i * w + j)
    top = source[at] + fu * (source[at + np.uint32(1)] - source[at])
    at += np.uint32(w)
    low = source[at] + fu * (source[at + np.uint32(1)] - source[at])
    centre = top + fv * (low - top)
    sharp = np.float32(0.5 / (level_sigma * level_sigma))
    for k in range(SAMPLES):
        dx, dy = DX[k], DY[k]
        e = one / (one + fc1 * dx + fc2 * dy)
        u, v = (fu0 + fu1 * dx + fu2 * dy) * e, (fv0 + fv1 * dx + fv2 * dy) * e
        j, i = np.int32(u), np.int32(v)
        fu, fv = u - np.float32(j), v - np.float32(i)
        at = np.uint32(i * w + j)
        top = source[at] + fu * (source[at + np.uint32(1)] - source[at])
        at += np.uint32(w)
        low = source[at] + fu * (source[at + np.uint32(1)] - source[at])
        s = top + fv * (low - top) - centre
        q = one / (one + s * s * sharp)
        ws = weight[k] * q * q
        r = value[k] - np.float32(mean)
        total += ws
        v1 += ws * r
        v2 += ws * r * r
        s1 += ws * s
        s2 += ws * s * s
        cross += ws * s * r
    if total < LEAST_WEIGHT:
        return WORST
    s1, s2, v1, v2, cross = s1 / total, s2 / total, v1 / total, v2 / total, cross / total
    spread, own = s2 - s1 * s1, v2 - v1 * v1
    if spread < 0.05 or own < 0.05:
        return WORST
    return 1.0 - (cross - s1 * v1) / math.sqrt(spread * own)


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _cost(x, y, d, n0, n1, n2, weight, value, mean, inverse, sources, h, w, Ks, Rs, ts, each, level_sigma):  # type: ignore[no-untyped-def]
    """Mean of the best BEST sources' costs."""
    count = len(sources)
    for s in range(count):
        each[s] = _ncc_cost(
            x, y, d, n0, n1, n2, weight, value, mean, inverse, sources[s], h, w, Ks[s], Rs[s], ts[s], level_sigma
        )
    best = min(BEST, count)
    total = 0.0
    for _ in range(best):
        low, at = 9.0, 0
        for s in range(count):
            if each[s] < low:
                low, at = each[s], s
        total += low
        each[at] = 9.0
    return total / best


@nb.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def sweep(
    image,
    mask,
    depth,
    normal,
    cost,
    sources,
    sh,
    sw,
    inverse,
    Ks,
    Rs,
    ts,
    near,
    far,
    colour,
    iteration,
    scale,
    tries,
    reach,
    seed,
    level_sigma,
    least_variance,
    first,
    last,
):  # type: ignore[no-untyped-def]
    """One half of a red-black iteration, in place.

    Args:
        image: (h, w) float32; mask: (h, w) uint8, 0 off the object, 1 on it, 2 and above where a depth is wanted.
        depth (h, w), normal (h, w, 3), cost (h, w): float32 state; cost < 0 means not judged yet.
        sources: (s, sh * sw) float32, flat images of sh rows and sw columns; Ks (s, 4) fu fv cu cv; Rs (s, 3, 3), ts (s, 3): reference camera to source camera.
        inverse: of the reference, (4,) 1/fu, -cu/fu, 1/fv, -cv/fv.
        near, far: range of depths.
        colour: 0 or 1: which half; iteration, seed: of the random steps.
        scale: relative size of the steps; tries: steps per pixel; reach: farthest neighbour asked.
        level_sigma: grey-level width of the bilateral weight; least_variance: below it there is no texture.
        first, last: rows to work on, [first, last).
    """
    h, w = image.shape
    weight = np.empty(SAMPLES, np.float32)
    value = np.empty(SAMPLES, np.float32)
    each = np.empty(len(sources), np.float64)
    for y in range(first, last):
        for x in range((y + colour) % 2, w, 2):
            if mask[y, x] < 2:
                continue
            variance, mean = _window(image, mask, x, y, weight, value, level_sigma)
            if variance < least_variance:
                cost[y, x] = WORST
                continue
            rx, ry = inverse[0] * x + inverse[1], inverse[2] * y + inverse[3]
            d, n0, n1, n2, c = depth[y, x], normal[y, x, 0], normal[y, x, 1], normal[y, x, 2], cost[y, x]
            size = scale
            # the plane itself when it is not judged yet, those of neighbours, random steps: judged in one place, since
            # every call is compiled on its own
            for k in range(-1, 4 * reach + tries):
                if k < 0:
                    if c >= 0.0:
                        continue
                    e, m0, m1, m2 = d, n0, n1, n2
                elif k < 4 * reach:
                    far_step = 1 + 2 * (k // 4)
                    i, j = y, x
                    if k % 4 == 0:
                        j = x - far_step
                    elif k % 4 == 1:
                        j = x + far_step
                    elif k % 4 == 2:
                        i = y - far_step
                    else:
                        i = y + far_step
                    if i < 0 or j < 0 or i >= h or j >= w or mask[i, j] == 0 or depth[i, j] <= 0.0:
                        continue
                    m0, m1, m2 = normal[i, j, 0], normal[i, j, 1], normal[i, j, 2]
                    slope = m0 * rx + m1 * ry + m2
                    if slope > -0.05:
                        continue
                    jx, jy = inverse[0] * j + inverse[1], inverse[2] * i + inverse[3]
                    e = depth[i, j] * (m0 * jx + m1 * jy + m2) / slope
                    if e < near or e > far:
                        continue
                    if abs(e - d) < 3e-5 * d and m0 * n0 + m1 * n1 + m2 * n2 > 0.9995:
                        continue  # the same plane to a small part of a pixel
                else:
                    t = k - 4 * reach
                    a = _hash(y * w + x, iteration * 64 + t * 4, colour, seed)
                    e = d + a * size * (far - near)
                    m0 = n0 + size * 3.0 * _hash(y * w + x, iteration * 64 + t * 4 + 1, colour, seed)
                    m1 = n1 + size * 3.0 * _hash(y * w + x, iteration * 64 + t * 4 + 2, colour, seed)
                    m2 = n2 + size * 3.0 * _hash(y * w + x, iteration * 64 + t * 4 + 3, colour, seed)
                    if t % 3 == 1:
                        m0, m1, m2 = n0, n1, n2
                    elif t % 3 == 2:
                        e = d
                    length = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2) + 1e-12
                    m0, m1, m2 = m0 / length, m1 / length, m2 / length
                    if m0 * rx + m1 * ry + m2 > -0.05 or e < near or e > far:
                        continue
                    size *= 0.6
                g = _cost(
                    x, y, e, m0, m1, m2, weight, value, mean, inverse, sources, sh, sw, Ks, Rs, ts, each, level_sigma
                )
                if k < 0 or g < c:
                    d, n0, n1, n2, c = e, m0, m1, m2, g
            depth[y, x], cost[y, x] = d, c
            normal[y, x, 0], normal[y, x, 1], normal[y, x, 2] = n0, n1, n2


@nb.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def polish(
    image,
    mask,
    depth,
    normal,
    cost,
    sigma,
    sources,
    sh,
    sw,
    inverse,
    Ks,
    Rs,
    ts,
    level_sigma,
    least_variance,
    noise_px,
    first,
    last,
):  # type: ignore[no-untyped-def]
    """Last step in depth by a parabola through the cost at half a pixel of parallax either side, and its 1-sigma.

    Shapes as in `sweep`; `sigma` (h, w) float32 is written: one sigma of the depth along the line of sight, from the
    parallax per depth of the sources and `noise_px`, widened where the cost is high or flat; `first`, `last` bound the rows.
    """
    h, w = image.shape
    weight = np.empty(SAMPLES, np.float32)
    value = np.empty(SAMPLES, np.float32)
    each = np.empty(len(sources), np.float64)
    for y in range(first, last):
        for x in range(w):
            sigma[y, x] = 0.0
            if mask[y, x] < 2 or cost[y, x] >= WORST or cost[y, x] < 0.0:
                continue
            variance, mean = _window(image, mask, x, y, weight, value, level_sigma)
            if variance < least_variance:
                cost[y, x] = WORST
                continue
            rx, ry = inverse[0] * x + inverse[1], inverse[2] * y + inverse[3]
            d, n0, n1, n2 = depth[y, x], normal[y, x, 0], normal[y, x, 1], normal[y, x, 2]
            parallax = 0.0
            for s in range(len(sources)):
                X = d * (Rs[s, 0, 0] * rx + Rs[s, 0, 1] * ry + Rs[s, 0, 2]) + ts[s, 0]
                Y = d * (Rs[s, 1, 0] * rx + Rs[s, 1, 1] * ry + Rs[s, 1, 2]) + ts[s, 1]
                Z = d * (Rs[s, 2, 0] * rx + Rs[s, 2, 1] * ry + Rs[s, 2, 2]) + ts[s, 2]
                dX = Rs[s, 0, 0] * rx + Rs[s, 0, 1] * ry + Rs[s, 0, 2]
                dY = Rs[s, 1, 0] * rx + Rs[s, 1, 1] * ry + Rs[s, 1, 2]
                dZ = Rs[s, 2, 0] * rx + Rs[s, 2, 1] * ry + Rs[s, 2, 2]
                if Z <= 1e-9:
                    continue
                du = Ks[s, 0] * (dX * Z - X * dZ) / (Z * Z)
                dv = Ks[s, 1] * (dY * Z - Y * dZ) / (Z * Z)
                parallax += du * du + dv * dv
            parallax = math.sqrt(parallax / len(sources)) + 1e-12
            step = 0.5 / parallax
            c = cost[y, x]
            low, high = c, c
            for side in (-1.0, 1.0):  # one call: each is compiled on its own
                g = _cost(
                    x,
                    y,
                    d + side * step,
                    n0,
                    n1,
                    n2,
                    weight,
                    value,
                    mean,
                    inverse,
                    sources,
                    sh,
                    sw,
                    Ks,
                    Rs,
                    ts,
                    each,
                    level_sigma,
                )
                low, high = (g, high) if side < 0.0 else (low, g)
            bend = low + high - 2.0 * c
            if bend > 1e-4 and low < WORST and high < WORST:
                move = 0.5 * (low - high) / bend
                depth[y, x] = d + step * min(max(move, -1.0), 1.0)
                flat = min(max(0.05 / bend, 1.0), 9.0)
            else:
                flat = 9.0
            sigma[y, x] = noise_px / parallax * math.sqrt(flat) * (1.0 + 2.0 * c)


def grey_pyramid_half(image: np.ndarray) -> np.ndarray:
    """Half the size by area, (h // 2, w // 2)."""
    h, w = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    return image[:h, :w].reshape(h // 2, 2, w // 2, 2).mean(axis=(1, 3), dtype=np.float32)
