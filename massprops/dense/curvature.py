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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_curvature(depth: Array, bent: Array, first: int, last: int) -> None:
    """Local quadratic fits of the inverse depth, by Tukey's biweight, relative to the inverse depth of the pixel.

    Args:
        depth: (h, w) float32, 0 where none.
        bent: (h, w, 3) float32, written: relative second derivatives by columns, by both, and by rows [1/px^2]; 0 where
            too few pixels about have a depth.
        first, last: rows to work on, [first, last).
    """
    most = ((2 * REACH) // STRIDE + 1) ** 2
    design, value = np.empty((most, TERMS)), np.empty(most)
    rest, weight = np.empty(most), np.empty(most)
    normal, answer = np.empty((TERMS, TERMS)), np.empty(TERMS)
    for y in range(first, last):
        for x in range(depth.shape[1]):
            bent[y, x, 0] = bent[y, x, 1] = bent[y, x, 2] = 0.0
            if depth[y, x] <= 0.0:
                continue
            n = _gather(depth, x, y, design, value)
            if n >= LEAST and _robust(design, value, n, rest, weight, normal, answer):
                bent[y, x, 0] = 2.0 * answer[3] / (REACH * REACH)
                bent[y, x, 1] = answer[4] / (REACH * REACH)
                bent[y, x, 2] = 2.0 * answer[5] / (REACH * REACH)


@nb.njit(inline="always", error_model="numpy")
def _gather(depth: Array, x: int, y: int, design: Array, value: Array) -> int:
    """Writes the terms and the relative inverse depth of every pixel about that has one; gives their number."""
    h, w = depth.shape
    n = 0
    for dy in range(-REACH, REACH + 1, STRIDE):
        for dx in range(-REACH, REACH + 1, STRIDE):
            i, j = y + dy, x + dx
            if i < 0 or j < 0 or i >= h or j >= w or depth[i, j] <= 0.0:
                continue
            a, b = dx / REACH, dy / REACH
            design[n, 0], design[n, 1], design[n, 2] = 1.0, a, b
            design[n, 3], design[n, 4], design[n, 5] = a * a, a * b, b * b
            value[n] = depth[y, x] / depth[i, j]
            n += 1
    return n


@nb.njit(inline="always", error_model="numpy")
def _robust(design: Array, value: Array, n: int, rest: Array, weight: Array, normal: Array, answer: Array) -> bool:
    """Least squares of the first n rows into `answer`, weighted anew ROUNDS times; False where they fix no answer.

    Begins with the middle: what lies behind an edge at the margin would draw a fit of all.
    """
    inner = 0
    for k in range(n):
        weight[k] = 1.0 if max(abs(design[k, 1]), abs(design[k, 2])) <= 0.5 else 0.0
        inner += weight[k] > 0.0
    good = inner >= 2 * TERMS
    if not good:
        return False
    for turn in range(ROUNDS + 1):
        normal[:], answer[:] = 0.0, 0.0
        for k in range(n):
            for p in range(TERMS):
                f = weight[k] * design[k, p]
                answer[p] += f * value[k]
                for q in range(p + 1):
                    normal[p, q] += f * design[k, q]
        for p in range(TERMS):
            normal[p, p] += RIDGE * n
        good = _solve(normal, answer)
        if not good or turn == ROUNDS:
            break
        for k in range(n):
            fit = 0.0
            for p in range(TERMS):
                fit += design[k, p] * answer[p]
            rest[k] = abs(value[k] - fit)
        width = TUKEY * MAD_TO_SIGMA * np.median(rest[:n]) + 1e-9
        for k in range(n):
            t = rest[k] / width
            weight[k] = (1.0 - t * t) ** 2 if t < 1.0 else 0.0
    return good


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
