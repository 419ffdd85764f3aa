"""Torque-free attitude and rates at given times, as plain loops to be compiled with `filters.components`.

No whole arrays are added or assigned: numba compiles a loop in a tenth of the time.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import N, euler_acceleration
from massprops.estimators.filters.components import torque_free

COMPILED = ("massprops.dynamics.kernels", "massprops.estimators.filters.components", __name__)
"""What its functions are compiled with."""


def acceleration(inertia: tuple[N, ...], wx: N, wy: N, wz: N) -> tuple[N, N, N]:
    """In place of that of `components`: for inertia (xx, yy, zz, xy, xz, yz)."""
    return euler_acceleration(inertia, (wx, wy, wz), (0.0, 0.0, 0.0))


def free_turn(y: np.ndarray, I: np.ndarray, time: float, largest_turn: float) -> None:
    """Moves attitude and rates y (7,) on by `time` [s] in place, at most largest_turn [rad] a step; I: (6,) as of
    `acceleration`."""
    turn = np.sqrt(y[4] ** 2 + y[5] ** 2 + y[6] ** 2) * abs(time)
    steps = 1
    if turn > largest_turn:
        steps = int(min(10000.0, np.ceil(turn / largest_turn)))
    six = (I[0], I[1], I[2], I[3], I[4], I[5])
    end = torque_free((y[4], y[5], y[6]), (y[0], y[1], y[2], y[3]), six, time, steps)
    y[4], y[5], y[6], y[0], y[1], y[2], y[3] = end


def free_path(y0: np.ndarray, I: np.ndarray, times: np.ndarray, largest_turn: float) -> np.ndarray:
    """States (n, 7) at times (n,) [s] from y0 (7,) at the first: attitude, then rates in body axes [rad/s]; I (6,) and largest_turn as
    of `free_turn`."""
    out, y = np.empty((times.shape[0], 7)), np.empty(7)
    for i in range(7):
        out[0, i] = y[i] = y0[i]
    for row in range(1, times.shape[0]):
        free_turn(y, I, times[row] - times[row - 1], largest_turn)
        for i in range(7):
            out[row, i] = y[i]
    return out


def free_windows(tau: np.ndarray, w: np.ndarray, I: np.ndarray, largest_turn: float) -> np.ndarray:
    """Attitudes (r, L, 4) at times tau (r, L) [s], which ascend through zero, of bodies that have the rates w (r, 3) [rad/s] and
    no turn at time zero; I (6,) and largest_turn as of `free_turn`."""
    r, L = tau.shape
    out, y = np.empty((r, L, 4)), np.empty(7)
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
                free_turn(y, I, tau[row, at] - before, largest_turn)
                for i in range(4):
                    out[row, at, i] = y[i]
                before = tau[row, at]
                at += side
    return out
