"""Free rotation over many short windows, compiled; import it late."""

from __future__ import annotations

import numba
import numpy as np

from massprops.estimators.compiled import euler_acceleration, quaternion_rate


@numba.njit(cache=True)
def _slope(y, I, out):  # type: ignore[no-untyped-def]
    out[0], out[1], out[2], out[3] = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    out[4], out[5], out[6] = euler_acceleration(I[0], I[1], I[2], I[3], I[4], I[5], y[4], y[5], y[6], 0.0, 0.0, 0.0)


@numba.njit(cache=True)
def free_windows(tau, w, I, largest_step):  # type: ignore[no-untyped-def]
    """Attitudes (r, L, 4) at times tau (r, L) [s], which ascend through zero, of bodies that have the rates w (r, 3) and
    no turn at time zero.

    Args:
        I: (6,) xx, yy, zz, xy, xz, yz; largest_step: rotation [rad] per Runge-Kutta step.
    """
    r, L = tau.shape
    out = np.empty((r, L, 4))
    y, z, a, b, c, d = np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    for row in range(r):
        speed = np.sqrt(w[row, 0] ** 2 + w[row, 1] ** 2 + w[row, 2] ** 2)
        middle = np.argmin(np.abs(tau[row]))
        for side in (1, -1):
            y[:] = 0.0
            y[0] = 1.0
            y[4:] = w[row]
            before = 0.0
            at = middle
            while 0 <= at < L:
                whole = tau[row, at] - before
                turn = speed * abs(whole)
                steps = 1
                if turn > largest_step:
                    steps = int(min(10000.0, np.ceil(turn / largest_step)))
                h = whole / steps
                for _ in range(steps):
                    _slope(y, I, a)
                    for i in range(7):
                        z[i] = y[i] + h / 2 * a[i]
                    _slope(z, I, b)
                    for i in range(7):
                        z[i] = y[i] + h / 2 * b[i]
                    _slope(z, I, c)
                    for i in range(7):
                        z[i] = y[i] + h * c[i]
                    _slope(z, I, d)
                    for i in range(7):
                        y[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i])
                size = np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2)
                for i in range(4):
                    out[row, at, i] = y[i] / size
                before = tau[row, at]
                at += side
    return out
