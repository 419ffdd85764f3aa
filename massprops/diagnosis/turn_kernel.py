"""`Balance.turned` compiled: small turns from a path, one step after the other; import it late."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def turned(
    t: np.ndarray, answer: np.ndarray, steps: np.ndarray, rate: np.ndarray, first: np.ndarray, less: float
) -> np.ndarray:
    """(n, 3, k) with phi' = (answer - [u]x) phi + rate - less u from `first` (3, k), by the trapezoid.

    Args:
        t: (n,) [s]; answer: (n, 3, 3); steps: (n - 1, 3) the path's own rate u, constant from each point to the next;
            rate: (n, 3, k); less: 1 where the path's own turning is taken off, else 0.
    """
    n, k = len(t), rate.shape[2]
    out = np.empty((n, 3, k))
    for a in range(3):  # not all at once, which takes numba two seconds more to compile
        for c in range(k):
            out[0, a, c] = first[a, c]
    added, ahead, inverse, step = np.empty((3, k)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(n - 1):
        half = 0.5 * (t[i + 1] - t[i])
        _one_plus(-half, answer[i + 1], steps[i], ahead)
        _inverse(ahead, inverse)
        _one_plus(half, answer[i], steps[i], step)
        for a in range(3):
            for c in range(k):
                added[a, c] = (
                    step[a, 0] * out[i, 0, c] + step[a, 1] * out[i, 1, c] + step[a, 2] * out[i, 2, c]
                    + half * (rate[i + 1, a, c] + rate[i, a, c]) - 2.0 * half * less * steps[i, a]
                )  # fmt: skip
        for a in range(3):
            for c in range(k):
                out[i + 1, a, c] = (
                    inverse[a, 0] * added[0, c] + inverse[a, 1] * added[1, c] + inverse[a, 2] * added[2, c]
                )
    return out


@numba.njit(cache=True)
def _one_plus(h: float, A: np.ndarray, u: np.ndarray, out: np.ndarray) -> None:
    """1 + h (A - [u]x) into `out` (3, 3); A: (3, 3); u: (3,) [1/s]; h [s]."""
    for a in range(3):
        for b in range(3):
            out[a, b] = h * A[a, b]
        out[a, a] += 1.0
    out[0, 1] += h * u[2]
    out[0, 2] -= h * u[1]
    out[1, 0] -= h * u[2]
    out[1, 2] += h * u[0]
    out[2, 0] += h * u[1]
    out[2, 1] -= h * u[0]


@numba.njit(cache=True, error_model="numpy")
def _inverse(M: np.ndarray, out: np.ndarray) -> None:
    """The inverse of M (3, 3) into `out` (3, 3), by cofactors."""
    for a in range(3):
        p, q = (a + 1) % 3, (a + 2) % 3
        for b in range(3):
            r, s = (b + 1) % 3, (b + 2) % 3
            out[b, a] = M[p, r] * M[q, s] - M[p, s] * M[q, r]
    determinant = M[0, 0] * out[0, 0] + M[0, 1] * out[1, 0] + M[0, 2] * out[2, 0]
    for a in range(3):
        for b in range(3):
            out[a, b] /= determinant
