"""Free rotation and relative orbit over one step with the rotation's derivatives, compiled; import it late."""

from __future__ import annotations

import numba
import numpy as np

from massprops.dynamics.compiled import (
    bind,
    differential_gravity,
    euler_acceleration,
    quaternion_rate,
    to_body,
    to_reference,
    unit,
)
from massprops.dynamics.kernels import INNER, NODES, TOTAL
from massprops.estimators import free_path
from massprops.estimators.filters import components

TINY = 1e-150
"""Complex step: so small that its square vanishes."""
_acceleration = bind(free_path.acceleration, euler_acceleration=euler_acceleration)
_torque_free = bind(components.torque_free, acceleration=_acceleration, quaternion_rate=quaternion_rate, unit=unit)


@numba.njit(cache=True)
def rotated(
    q: np.ndarray, W: np.ndarray, six: np.ndarray, dt: float, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitude and rates of B runs after dt [s], by `steps` Runge-Kutta steps, and their derivatives by the complex step.

    Args:
        q: (B, 4) body to inertial; W: (B, 3) inertial axes [rad/s]; six: (B, 6, 6 + p) complex inertia elements, column
            6 + i moved by i TINY along parameter i.

    Returns:
        q (B, 4), W (B, 3), and (B, 6, 6 + p): W and the small turn in body axes by W, the turn, and the parameters.
    """
    B, count = six.shape[0], six.shape[2]
    q1, W1, core = np.empty((B, 4)), np.empty((B, 3)), np.empty((B, 6, count))
    y = np.empty(7, np.complex128)
    start, way = np.empty(7, np.complex128), np.empty((3, 4))
    for b in range(B):
        for j in range(count):
            for i in range(4):
                start[i] = q[b, i]
            for i in range(3):
                start[4 + i] = W[b, i]
            if j < 3:
                start[4 + j] += 1j * TINY
            elif j < 6:
                _along(q[b], way)
                for i in range(4):
                    start[i] += 0.5j * TINY * way[j - 3, i]
            for i in range(4):
                y[i] = start[i]
            y[4], y[5], y[6] = to_body(start[0], start[1], start[2], start[3], start[4], start[5], start[6])
            inertia = (six[b, 0, j], six[b, 1, j], six[b, 2, j], six[b, 3, j], six[b, 4, j], six[b, 5, j])
            end = _torque_free((y[4], y[5], y[6]), (y[0], y[1], y[2], y[3]), inertia, dt, steps)
            y[4], y[5], y[6], y[0], y[1], y[2], y[3] = end
            x, u, z = to_reference(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
            core[b, 0, j], core[b, 1, j], core[b, 2, j] = x.imag / TINY, u.imag / TINY, z.imag / TINY
            if j == 0:
                for i in range(4):
                    q1[b, i] = y[i].real
                W1[b, 0], W1[b, 1], W1[b, 2] = x.real, u.real, z.real
            _along(q1[b], way)
            for i in range(3):
                total = 0.0
                for a in range(4):
                    total += way[i, a] * y[a].imag
                core[b, 3 + i, j] = 2.0 * total / TINY
    return q1, W1, core


@numba.njit(cache=True)
def _along(q: np.ndarray, way: np.ndarray) -> None:
    """Twice the derivative of q exp(theta), q (4,), by theta, into way (3, 4)."""
    w, x, y, z = q
    way[0, 0], way[0, 1], way[0, 2], way[0, 3] = -x, w, z, -y
    way[1, 0], way[1, 1], way[1, 2], way[1, 3] = -y, -z, w, x
    way[2, 0], way[2, 1], way[2, 2], way[2, 3] = -z, y, -x, w


@numba.njit(cache=True)
def moved(r: np.ndarray, v: np.ndarray, leaders: np.ndarray, mu: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Place [m] and velocity [m/s], (B, 3) each, after dt [s] from r, v (B, 3), beside a chaser that is at `leaders` (3, 3) [m] first,
    amid and last; mu [m^3/s^2]."""
    r1, v1 = np.empty_like(r), np.empty_like(v)
    h2, h3, h4 = NODES[1] * dt, NODES[2] * dt, NODES[3] * dt
    for b in range(len(r)):
        a1 = _pull(mu, leaders[0], r[b])
        v2 = v[b] + h2 * a1
        a2 = _pull(mu, leaders[1], r[b] + h2 * v[b])
        v3 = v[b] + h3 * a2
        a3 = _pull(mu, leaders[1], r[b] + h3 * v2)
        v4 = v[b] + h4 * a3
        a4 = _pull(mu, leaders[2], r[b] + h4 * v3)
        for i in range(3):
            r1[b, i] = r[b, i] + dt / TOTAL * (v[b, i] + INNER * v2[i] + INNER * v3[i] + v4[i])
            v1[b, i] = v[b, i] + dt / TOTAL * (a1[i] + INNER * a2[i] + INNER * a3[i] + a4[i])
    return r1, v1


@numba.njit(cache=True)
def _pull(mu: float, leader: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Acceleration (3,) [m/s^2] at r (3,) from a chaser that is at leader (3,) [m]."""
    x, y, z = differential_gravity(mu, leader[0], leader[1], leader[2], r[0], r[1], r[2])
    return np.array([x, y, z])
