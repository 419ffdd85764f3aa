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
