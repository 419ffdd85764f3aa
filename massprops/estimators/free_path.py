"""Torque-free attitude and rates at given times, as plain loops to be compiled with `dynamics.kernels`."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import euler_acceleration, quaternion_rate


def free_slope(y, I):  # type: ignore[no-untyped-def]
    """Derivative of attitude and rates (7) for inertia I = (xx, yy, zz, xy, xz, yz)."""
    a = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    b = euler_acceleration(I[0], I[1], I[2], I[3], I[4], I[5], y[4], y[5], y[6], 0.0, 0.0, 0.0)
    return np.array([a[0], a[1], a[2], a[3], b[0], b[1], b[2]])


def free_path(y0, I, times, largest_turn):  # type: ignore[no-untyped-def]
    """States (n, 7) at times (n,) from y0 (7,) at the first: attitude, then rates in body axes."""
    out = np.empty((times.shape[0], 7))
    y = y0.copy()
    out[0] = y
    for i in range(1, times.shape[0]):
        dt = times[i] - times[i - 1]
        speed = np.sqrt(y[4] ** 2 + y[5] ** 2 + y[6] ** 2)
        steps = min(max(1, int(np.ceil(speed * abs(dt) / largest_turn))), 10000)
        h = dt / steps
        for _ in range(steps):
            a = free_slope(y, I)
            b = free_slope(y + 0.5 * h * a, I)
            c = free_slope(y + 0.5 * h * b, I)
            d = free_slope(y + h * c, I)
            y = y + h / 6.0 * (a + 2.0 * (b + c) + d)
        size = np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2)
        for j in range(4):
            y[j] /= size
        out[i] = y
    return out
