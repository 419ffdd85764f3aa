"""Torque-free attitude and rates at given times, as plain loops to be compiled with `dynamics.kernels`.

No whole arrays are added or assigned: numba compiles a loop in a tenth of the time.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import euler_acceleration, quaternion_rate


def free_slope(y: np.ndarray, I: np.ndarray, out: np.ndarray) -> None:
    """Derivative of attitude and rates y (7,) into out (7,), for inertia I = (xx, yy, zz, xy, xz, yz)."""
    out[0], out[1], out[2], out[3] = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    out[4], out[5], out[6] = euler_acceleration(
        (I[0], I[1], I[2], I[3], I[4], I[5]), (y[4], y[5], y[6]), (0.0, 0.0, 0.0)
    )


def free_turn(y: np.ndarray, I: np.ndarray, time: float, largest_turn: float, work: np.ndarray) -> None:
    """Moves y (7,) on by `time` [s] in place (Runge and Kutta, fourth order), at most largest_turn [rad] a step; the
    attitude stays a unit quaternion. work: (5, 7)."""
    turn = np.sqrt(y[4] ** 2 + y[5] ** 2 + y[6] ** 2) * abs(time)
    steps = 1
    if turn > largest_turn:
        steps = int(min(10000.0, np.ceil(turn / largest_turn)))
    h = time / steps
    a, b, c, d, z = work[0], work[1], work[2], work[3], work[4]
    for _ in range(steps):
        free_slope(y, I, a)
        for i in range(7):
            z[i] = y[i] + 0.5 * h * a[i]
        free_slope(z, I, b)
        for i in range(7):
            z[i] = y[i] + 0.5 * h * b[i]
        free_slope(z, I, c)
        for i in range(7):
            z[i] = y[i] + h * c[i]
        free_slope(z, I, d)
        for i in range(7):
            y[i] += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i])
    size = np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2)
    for i in range(4):
        y[i] /= size


def free_path(y0: np.ndarray, I: np.ndarray, times: np.ndarray, largest_turn: float) -> np.ndarray:
    """States (n, 7) at times (n,) from y0 (7,) at the first: attitude, then rates in body axes."""
    out, y, work = np.empty((times.shape[0], 7)), np.empty(7), np.empty((5, 7))
    for i in range(7):
        out[0, i] = y[i] = y0[i]
    for row in range(1, times.shape[0]):
        free_turn(y, I, times[row] - times[row - 1], largest_turn, work)
        for i in range(7):
            out[row, i] = y[i]
    return out


def free_windows(tau: np.ndarray, w: np.ndarray, I: np.ndarray, largest_turn: float) -> np.ndarray:
    """Attitudes (r, L, 4) at times tau (r, L) [s], which ascend through zero, of bodies that have the rates w (r, 3) and
    no turn at time zero; I and largest_turn as of the others."""
    r, L = tau.shape
    out, y, work = np.empty((r, L, 4)), np.empty(7), np.empty((5, 7))
    for row in range(r):
        middle = 0
        for i in range(L):
            if abs(tau[row, i]) < abs(tau[row, middle]):
                middle = i
        for side in (1, -1):
            y[0] = 1.0
            for i in range(3):
                y[1 + i] = 0.0
                y[4 + i] = w[row, i]
            before, at = 0.0, middle
            while 0 <= at < L:
                free_turn(y, I, tau[row, at] - before, largest_turn, work)
                for i in range(4):
                    out[row, at, i] = y[i]
                before = tau[row, at]
                at += side
    return out
