"""How a depth map bends: second derivatives of the inverse depth, by which windows follow a curved surface.

A plane has an inverse depth that is linear in the pixel. A window that is matched as a plane on a surface that bends
away from the camera fits best where the plane lies a little deep: the depth found is that of the window's mean. On a
small convex thing this is the greatest error of the middle (`docs/measurements.md`), and the same in all views.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from massprops.core.robust import MAD_TO_SIGMA

Array = np.ndarray

REACH, STRIDE = 8, 2
"""Pixels, and every which of them, that a fit looks at: twice the matching window, so that the noise of what one window
measured, which its neighbours share, is averaged."""
TERMS = 6
LEAST = 4 * TERMS
"""Fewest pixels of a fit."""
ROUNDS = 3
TUKEY = 4.685
"""Tuning constant of Tukey's biweight, for 95 % of the efficiency on normal errors."""
RIDGE = 1e-6
"""Share of the number of pixels that is added to the diagonal of the normal equations: far below what a window spans."""
LEAST_REST, HALVES = np.float32(1e-9), 11
"""Least residual that counts, and steps by which the median is found above it: to one part in a hundred."""

_POWERS = np.array([(i, n - i) for n in range(5) for i in range(n, -1, -1)])
"""Of a and b, of the moments that the normal equations are made of; the first TERMS are a fit's terms."""
_OFFSETS = np.arange(-REACH, REACH + 1, STRIDE)
PIXELS = 96
"""Room for the 81 pixels of a fit: loops that are unrolled by 32 leave no remainder."""
_A, _B = (np.resize(a, PIXELS) / REACH for a in np.meshgrid(_OFFSETS, _OFFSETS))
MONOMIALS = np.stack([_A**i * _B**j for i, j in _POWERS]).astype(np.float32)
INNER = (np.maximum(abs(_A), abs(_B)) <= 0.5).astype(np.float32)
PRODUCT = np.array(
    [[np.flatnonzero((_POWERS[p] + _POWERS[q] == _POWERS).all(1))[0] for q in range(TERMS)] for p in range(TERMS)]
)
"""The moment that is the product of two terms."""


@nb.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def fit_curvature(depth: Array, wanted: Array, bent: Array, first: int, last: int) -> None:
    """Local quadratic fits of the inverse depth, by Tukey's biweight, relative to the inverse depth of the pixel.

    Args:
        depth: (h, w) float32, 0 where none.
        wanted: (h, w) bool, where a fit is asked for.
        bent: (h, w, 3) float32, written: relative second derivatives by columns, by both, and by rows [1/px^2]; 0 where
            too few pixels about have a depth, and where none is asked for.
        first, last: rows to work on, [first, last).
    """
    value, known = np.zeros(PIXELS, np.float32), np.zeros(PIXELS, np.float32)
    room, moment = np.empty((2, PIXELS), np.float32), np.empty(len(MONOMIALS))
    normal, answer = np.empty((TERMS, TERMS)), np.empty(TERMS)
    w = depth.shape[1]
    for y in range(first, last):
        for x in range(w):
            bent[y, x, 0] = bent[y, x, 1] = bent[y, x, 2] = 0.0
            next_one = x % 2 == 0 and x + 1 < w and wanted[y, x + 1]  # which takes this one's
            if depth[y, x] <= 0.0 or not (wanted[y, x] or next_one):
                continue
            if x % 2 == 1 and depth[y, x - 1] > 0.0:  # two neighbours have nearly all of their pixels in common
                for p in range(3):
                    bent[y, x, p] = bent[y, x - 1, p]
                continue
            n = _gather(depth, x, y, value, known)
            if n >= LEAST and _robust(value, known, n, room, moment, normal, answer):
                bent[y, x, 0] = 2.0 * answer[3] / (REACH * REACH)
                bent[y, x, 1] = answer[4] / (REACH * REACH)
                bent[y, x, 2] = 2.0 * answer[5] / (REACH * REACH)


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _gather(depth: Array, x: int, y: int, value: Array, known: Array) -> int:
    """Writes by how much the relative inverse depth of every pixel about differs from the middle's, and 1 where it has one or 0;
    gives the number of these."""
    h, w = depth.shape
    n, k = 0, 0
    for dy in range(-REACH, REACH + 1, STRIDE):
        for dx in range(-REACH, REACH + 1, STRIDE):
            i, j = y + dy, x + dx
            value[k] = known[k] = 0.0
            if i >= 0 and j >= 0 and i < h and j < w and depth[i, j] > 0.0:
                value[k], known[k] = (depth[y, x] - depth[i, j]) / depth[i, j], 1.0
                n += 1
            k += 1
    return n


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _robust(value: Array, known: Array, n: int, room: Array, moment: Array, normal: Array, answer: Array) -> bool:
    """Least squares of the n known values into `answer`, weighted anew ROUNDS times; False where they fix no answer.

    Begins with the middle: what lies behind an edge at the margin would draw a fit of all.
    """
    weight, rest = room[0], room[1]
    inner = np.float32(0.0)
    for k in range(PIXELS):
        weight[k] = INNER[k] * known[k]
        inner += weight[k]
    if inner < 2 * TERMS:
        return False
    good = True
    for turn in range(ROUNDS + 1):
        _normal_equations(value, weight, moment, normal, answer)
        for p in range(TERMS):
            normal[p, p] += RIDGE * n
        good = _solve(normal, answer)
        if not good or turn == ROUNDS:
            break
        for k in range(PIXELS):
            rest[k] = value[k]
        for p in range(TERMS):
            f = np.float32(answer[p])
            for k in range(PIXELS):
                rest[k] -= f * MONOMIALS[p, k]
        for k in range(PIXELS):
            rest[k] = abs(rest[k])
        width = np.float32(TUKEY * MAD_TO_SIGMA) * _median(rest, known, n)
        for k in range(PIXELS):
            t = min(rest[k] / width, np.float32(1.0))
            u = np.float32(1.0) - t * t
            weight[k] = known[k] * u * u
    return good


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _normal_equations(value: Array, weight: Array, moment: Array, normal: Array, answer: Array) -> None:
    """Their lower half and right side, of single precision's sums: of 81 terms none is far above 1."""
    for p in range(TERMS):
        s = np.float32(0.0)
        for k in range(PIXELS):
            s += weight[k] * value[k] * MONOMIALS[p, k]
        answer[p] = s
    for m in range(len(MONOMIALS)):
        s = np.float32(0.0)
        for k in range(PIXELS):
            s += weight[k] * MONOMIALS[m, k]
        moment[m] = s
    for p in range(TERMS):
        for q in range(p + 1):
            normal[p, q] = moment[PRODUCT[p, q]]


@nb.njit(inline="always", fastmath=True, error_model="numpy")
def _median(a: Array, known: Array, n: int) -> np.floating:
    """Of the n known values, all at least 0, to a hundredth of it: by halves of its logarithm, which costs no branches."""
    low, high = LEAST_REST, LEAST_REST
    for k in range(PIXELS):
        high = max(high, a[k] * known[k])
    for _ in range(HALVES):
        t = np.float32(math.sqrt(low * high))
        below = np.float32(0.0)
        for k in range(PIXELS):
            below += known[k] if a[k] < t else np.float32(0.0)
        if 2.0 * below < n:
            low = t
        else:
            high = t
    return high


@nb.njit(inline="always", error_model="numpy")
def _solve(a: Array, b: Array) -> bool:
    """Cholesky, in place: the answer is left in `b`; False where `a` (lower half) is not positive definite."""
    for p in range(TERMS):
        for q in range(p + 1):
            s = a[p, q]
            for r in range(q):
                s -= a[p, r] * a[q, r]
            if p == q:
                if s <= 0.0:
                    return False
                a[p, p] = math.sqrt(s)
            else:
                a[p, q] = s / a[q, q]
    for p in range(TERMS):
        s = b[p]
        for r in range(p):
            s -= a[p, r] * b[r]
        b[p] = s / a[p, p]
    for p in range(TERMS - 1, -1, -1):
        s = b[p]
        for r in range(p + 1, TERMS):
            s -= a[r, p] * b[r]
        b[p] = s / a[p, p]
    return True
