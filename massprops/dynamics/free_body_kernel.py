"""`rigid_body.propagate` compiled, for many bodies at once; import it late, since it loads numba."""

from __future__ import annotations

import numba
import numpy as np

from massprops.dynamics.compiled import cross, quaternion_rate
from massprops.dynamics.kernels import INNER, NODES, TOTAL

GROWN = 2.0
"""Times its first energy that a body has where its integration has failed: where it has not, steps keep it to 1e-6."""


@numba.njit(cache=True, error_model="numpy")
def propagated(
    y0: np.ndarray, inertia: np.ndarray, inverse: np.ndarray, times: np.ndarray, largest_turn: float
) -> np.ndarray:
    """States (n, m, 7) at times (n,), attitude and rate, from y0 (m, 7) at the first of them; inertia, inverse: (m, 3, 3).

    A free body keeps its energy. Where the steps are too long for a body's inertia it grows instead: its states are no numbers from
    there on.
    """
    n, m = len(times), len(y0)
    out, k = np.empty((n, m, 7)), np.empty((4, 7))
    out[0] = y0
    most = np.empty(m)
    for b in range(m):
        most[b] = GROWN * _energy(y0[b], inertia[b])
    for row in range(1, n):
        speed = 0.0
        for b in range(m):
            wx, wy, wz = out[row - 1, b, 4], out[row - 1, b, 5], out[row - 1, b, 6]
            of_body = np.sqrt(wx * wx + wy * wy + wz * wz)
            if of_body > speed:
                speed = of_body
        span = times[row] - times[row - 1]
        steps = max(1, int(np.ceil(speed * abs(span) / largest_turn)))
        h = span / steps
        for b in range(m):
            y = out[row, b]
            for i in range(7):
                y[i] = out[row - 1, b, i]
            for _ in range(steps):
                _step(y, inertia[b], inverse[b], h, k)
            if not _energy(y, inertia[b]) <= most[b]:
                y[:] = np.nan
    return out


@numba.njit(cache=True, error_model="numpy")
def _energy(y: np.ndarray, I: np.ndarray) -> float:
    """Twice the energy of a state y (7,) with inertia I (3, 3)."""
    energy = 0.0
    for i in range(3):
        for j in range(3):
            energy += y[4 + i] * I[i, j] * y[4 + j]
    return energy


@numba.njit(cache=True, error_model="numpy")
def _step(y: np.ndarray, inertia: np.ndarray, inverse: np.ndarray, h: float, k: np.ndarray) -> None:
    """Moves a state y (7,) on by a step h [s] of Runge and Kutta's method, in place; inertia, inverse: (3, 3); k: (4, 7) room for its
    slopes."""
    z = np.empty(7)
    for stage in range(4):
        reach = NODES[stage] * h
        for i in range(7):
            z[i] = y[i] + reach * k[stage - 1, i] if stage else y[i]
        _slope(z, inertia, inverse, k[stage])
    for i in range(7):
        y[i] += h / TOTAL * (k[0, i] + INNER * k[1, i] + INNER * k[2, i] + k[3, i])
    size = np.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3])
    for i in range(4):
        y[i] /= size


@numba.njit(cache=True, error_model="numpy")
def _slope(y: np.ndarray, I: np.ndarray, inverse: np.ndarray, out: np.ndarray) -> None:
    """Rates of y = (q 4, w 3 [rad/s]), (7,), into out (7,), of a free body of inertia I (3, 3) and its inverse (3, 3)."""
    wx, wy, wz = y[4], y[5], y[6]
    hx = I[0, 0] * wx + I[0, 1] * wy + I[0, 2] * wz
    hy = I[1, 0] * wx + I[1, 1] * wy + I[1, 2] * wz
    hz = I[2, 0] * wx + I[2, 1] * wy + I[2, 2] * wz
    gx, gy, gz = cross(wx, wy, wz, hx, hy, hz)
    out[0], out[1], out[2], out[3] = quaternion_rate(y[0], y[1], y[2], y[3], wx, wy, wz)
    for i in range(3):
        out[4 + i] = -(inverse[i, 0] * gx + inverse[i, 1] * gy + inverse[i, 2] * gz)
