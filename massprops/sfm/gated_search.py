"""Features of an image that lie where others are looked for, and which of them is the likest by far."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from massprops.sfm.distinct import APART, RATIO, WIDEST, angles

Grid = tuple[np.ndarray, np.ndarray, np.ndarray, float, int, int]
"""Places by their cells, where each cell begins, the first cell's corner (2,), the cells' side [px], and how many there are either way."""


def within(uv: np.ndarray, middle: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs, numbers (g,) of a middle (k, 2) in rising order and (g,) of a place uv (m, 2), that are within reach (k,) [px]."""
    if not len(middle) or not len(uv):
        return np.zeros(0, int), np.zeros(0, int)
    uv, middle, reach = (np.ascontiguousarray(x, float) for x in (uv, middle, reach))
    first = uv.min(axis=0)
    # cells as wide as the typical reach, and about as many as there are places at most
    extent = np.ptp(uv, axis=0)
    side = max(float(np.median(reach)), float(np.sqrt(extent.prod() / len(uv))), float(extent.max()) / len(uv), 1e-9)
    cell = np.floor((uv - first) / side).astype(np.int64)
    shape = cell.max(axis=0) + 1
    flat = cell[:, 0] * shape[1] + cell[:, 1]
    order = np.argsort(flat, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=int(shape.prod())))])
    grid = (order, start, first, side, int(shape[0]), int(shape[1]))
    none = np.zeros(0, np.int64)
    size = _within(uv, middle, reach, grid, none, none)
    which, other = np.zeros(size, np.int64), np.zeros(size, np.int64)
    _within(uv, middle, reach, grid, which, other)
    return which, other


@njit(cache=True, error_model="numpy")
def _within(
    uv: np.ndarray, middle: np.ndarray, reach: np.ndarray, grid: Grid, which: np.ndarray, other: np.ndarray
) -> int:
    """Number of pairs; written where there is room."""
    order, start, first, side, rows, columns = grid
    n = 0
    for k in range(len(middle)):
        u, v, r = middle[k, 0], middle[k, 1], reach[k]
        top = max(0, int(math.floor((u - r - first[0]) / side)))
        bottom = min(rows - 1, int(math.floor((u + r - first[0]) / side)))
        left = max(0, int(math.floor((v - r - first[1]) / side)))
        right = min(columns - 1, int(math.floor((v + r - first[1]) / side)))
        for i in range(top, bottom + 1):
            if left > right:
                break
            for at in range(start[i * columns + left], start[i * columns + right + 1]):
                m = order[at]
                x, y = uv[m, 0] - u, uv[m, 1] - v
                if x * x + y * y <= r * r:
                    if n < len(which):
                        which[n], other[n] = k, m
                    n += 1
    return n


def between(first: np.ndarray, second: np.ndarray, which: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(g,) angles [rad] between unit descriptors `which` (g,) of the first (k, d) and `other` (g,) of the second (m, d)."""
    return angles(_cosines(first, second, which, other))


@njit(cache=True, error_model="numpy", fastmath={"reassoc"})
def _cosines(first: np.ndarray, second: np.ndarray, which: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(g,) dot products; arguments as for `between`."""
    out = np.empty(len(which), first.dtype)
    for n in range(len(which)):
        a, b = first[which[n]], second[other[n]]
        total = first.dtype.type(0)
        for d in range(len(a)):
            total += a[d] * b[d]
        out[n] = total
    return out


def likest(which: np.ndarray, other: np.ndarray, angle: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of pairs (k,), what is looked for and a feature that it may be, those (g,) whose feature is the likest by far.

    Args:
        which: in rising order.
        angle: (k,) between their descriptors [rad], which counts up to `WIDEST`, and `RATIO` times that of the next best
            elsewhere; uv: (m, 2) places of all features [px].
    """
    return _likest(which, other, angle, np.ascontiguousarray(uv, float))


@njit(cache=True, error_model="numpy")
def _likest(which: np.ndarray, other: np.ndarray, angle: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What `likest` says."""
    matched, at, begin = np.empty_like(which), np.empty_like(other), 0
    n = 0
    while begin < len(which):
        end, best = begin, begin
        while end < len(which) and which[end] == which[begin]:
            if angle[end] < angle[best]:
                best = end
            end += 1
        # the next best elsewhere: a place may hold several features
        second = 0.5 * np.pi
        for k in range(begin, end):
            x = uv[other[k], 0] - uv[other[best], 0]
            y = uv[other[k], 1] - uv[other[best], 1]
            if x * x + y * y > APART * APART and angle[k] < second:
                second = angle[k]
        if angle[best] < WIDEST and angle[best] < RATIO * second:
            matched[n], at[n] = which[best], other[best]
            n += 1
        begin = end
    return matched[:n], at[:n]
