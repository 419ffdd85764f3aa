"""What linear equations of motion with known coefficients lead to, step after step, compiled; import it late."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def recurrence(step: np.ndarray, added: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(n, m, d) with y[k + 1] = step[k] y[k] + added[k], for m systems of d numbers each.

    Args:
        step: (n - 1, m, d, d); added: (n - 1, m, d); first: (m, d).
    """
    n, m, d = len(step) + 1, first.shape[0], first.shape[1]
    y = np.empty((n, m, d))
    y[0] = first
    for k in range(n - 1):
        for i in range(m):
            for a in range(d):
                total = added[k, i, a]
                for b in range(d):
                    total += step[k, i, a, b] * y[k, i, b]
                y[k + 1, i, a] = total
    return y


@numba.njit(cache=True)
def in_pairs(grown: np.ndarray, lever: np.ndarray, s: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(n, 3, k) answers A_ab = grown_a s_b + lever_a speed_b of m elements: A_ab + A_ba of each two of them, A_aa of one, then those
    of each element to the further drives.

    Args:
        grown: (n, m, 3); lever: (m, 3); s, speed: (n, m + d).
    """
    n, m, drives = len(grown), len(lever), s.shape[1]
    out = np.empty((n, 3, m * (m + 1) // 2 + m * (drives - m)))
    for k in range(n):
        for i in range(3):
            at = 0
            for a in range(m):
                for b in range(a, m):
                    value = grown[k, a, i] * s[k, b] + lever[a, i] * speed[k, b]
                    if a != b:
                        value += grown[k, b, i] * s[k, a] + lever[b, i] * speed[k, a]
                    out[k, i, at] = value
                    at += 1
            for a in range(m):
                for b in range(m, drives):
                    out[k, i, at] = grown[k, a, i] * s[k, b] + lever[a, i] * speed[k, b]
                    at += 1
    return out
