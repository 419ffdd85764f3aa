"""The equations of motion, component by component.

Each function takes and gives single components: Python numbers, complex numbers (for derivatives by the complex
step), arrays of any one shape (a batch of runs, or all times at once), or values inside a numba kernel. The physics
is written here once, and every simulator, filter and smoother calls it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

N = Any
"""A component: number or array."""

TINY = 1e-300
"""Keeps a length off zero without a branch; its root is far below anything measured."""

INSIDE = 1e-7
"""Stages at the ends of a step lie this share of it inside, so that an event at a step's end acts in one step only."""

NODES = (0.0, 0.5, 0.5, 1.0)
"""Runge and Kutta's method of fourth order: the share of a step after which each of its four slopes is taken, at the state to
which the slope before leads in that time."""
INNER, TOTAL = 2.0, 6.0
"""Its weights: of the second and the third slope, where the first and the last have one, and the sum of all four."""


def quaternion_rate(qw: N, qx: N, qy: N, qz: N, wx: N, wy: N, wz: N) -> tuple[N, N, N, N]:
    """q_dot = q (0, w) / 2 for Hamilton quaternions, w in body axes [rad/s]."""
    return (
        -0.5 * (qx * wx + qy * wy + qz * wz),
        0.5 * (qw * wx + qy * wz - qz * wy),
        0.5 * (qw * wy - qx * wz + qz * wx),
        0.5 * (qw * wz + qx * wy - qy * wx),
    )


def product(pw: N, px: N, py: N, pz: N, qw: N, qx: N, qy: N, qz: N) -> tuple[N, N, N, N]:
    """Quaternion p q."""
    return (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def unit(qw: N, qx: N, qy: N, qz: N) -> tuple[N, N, N, N]:
    """The unit quaternion of the same direction."""
    size = 1.0 / np.sqrt(qw * qw + qx * qx + qy * qy + qz * qz + TINY)
    return qw * size, qx * size, qy * size, qz * size


def turned(qw: N, qx: N, qy: N, qz: N, ax: N, ay: N, az: N) -> tuple[N, N, N, N]:
    """q exp(a): q turned by the rotation vector a [rad] in body axes."""
    angle = np.sqrt(ax * ax + ay * ay + az * az + TINY)
    s = np.sin(0.5 * angle) / angle
    return product(qw, qx, qy, qz, np.cos(0.5 * angle), s * ax, s * ay, s * az)


def turn_between(qw: N, qx: N, qy: N, qz: N, pw: N, px: N, py: N, pz: N) -> tuple[N, N, N]:
    """Rotation vector a [rad] with q exp(a) = p."""
    w, x, y, z = product(qw, -qx, -qy, -qz, pw, px, py, pz)
    sine = np.sqrt(x * x + y * y + z * z + TINY)
    sign = np.copysign(1.0, w)
    factor = 2.0 * np.arctan2(sine, sign * w) / sine * sign
    return factor * x, factor * y, factor * z


def symmetric_times(a: N, b: N, c: N, d: N, e: N, f: N, x: N, y: N, z: N) -> tuple[N, N, N]:
    """[[a, d, e], [d, b, f], [e, f, c]] (x, y, z)."""
    return a * x + d * y + e * z, d * x + b * y + f * z, e * x + f * y + c * z


def symmetric_solve(a: N, b: N, c: N, d: N, e: N, f: N, x: N, y: N, z: N) -> tuple[N, N, N]:
    """The solution of [[a, d, e], [d, b, f], [e, f, c]] s = (x, y, z), by cofactors."""
    A, B, C = b * c - f * f, a * c - e * e, a * b - d * d
    D, E, F = e * f - d * c, d * f - e * b, d * e - a * f
    whole = a * A + d * D + e * E
    return (A * x + D * y + E * z) / whole, (D * x + B * y + F * z) / whole, (E * x + F * y + C * z) / whole


def cross(ax: N, ay: N, az: N, bx: N, by: N, bz: N) -> tuple[N, N, N]:
    """a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def euler_acceleration(six: tuple[Any, ...], w: tuple[Any, ...], torque: tuple[Any, ...]) -> tuple[N, N, N]:
    """Euler's equations: w_dot = I^-1 (torque - w x I w), body axes.

    Args:
        six: Ixx, Iyy, Izz, Ixy, Ixz, Iyz, products as tensor elements; w: 3 rates; torque: 3.
    """
    ixx, iyy, izz, ixy, ixz, iyz = six
    wx, wy, wz = w
    tx, ty, tz = torque
    hx, hy, hz = symmetric_times(ixx, iyy, izz, ixy, ixz, iyz, wx, wy, wz)
    gx, gy, gz = cross(wx, wy, wz, hx, hy, hz)
    return symmetric_solve(ixx, iyy, izz, ixy, ixz, iyz, tx - gx, ty - gy, tz - gz)


def principal_acceleration(a: N, b: N, c: N, wx: N, wy: N, wz: N) -> tuple[N, N, N]:
    """Euler's equations without torque in principal axes: a = (I2 - I3)/I1, b = (I3 - I1)/I2, c = (I1 - I2)/I3."""
    return a * wy * wz, b * wx * wz, c * wx * wy


def to_body(qw: N, qx: N, qy: N, qz: N, vx: N, vy: N, vz: N) -> tuple[N, N, N]:
    """A vector of the reference frame in body axes: R(q)^T v."""
    tx, ty, tz = cross(qx, qy, qz, vx, vy, vz)
    ux, uy, uz = cross(qx, qy, qz, tx, ty, tz)
    return vx + 2.0 * (ux - qw * tx), vy + 2.0 * (uy - qw * ty), vz + 2.0 * (uz - qw * tz)


def to_reference(qw: N, qx: N, qy: N, qz: N, vx: N, vy: N, vz: N) -> tuple[N, N, N]:
    """A body vector in the reference frame: R(q) v."""
    tx, ty, tz = cross(qx, qy, qz, vx, vy, vz)
    ux, uy, uz = cross(qx, qy, qz, tx, ty, tz)
    return vx + 2.0 * (ux + qw * tx), vy + 2.0 * (uy + qw * ty), vz + 2.0 * (uz + qw * tz)


def differential_gravity(mu: N, lx: N, ly: N, lz: N, rx: N, ry: N, rz: N) -> tuple[N, N, N]:
    """Acceleration of a body at l + r relative to one at l, inertial axes [m/s^2] (pesce2017 eq 7, sign mended).

    Args:
        mu: [m^3/s^2]; l: chaser from the Earth's centre; r: target from the chaser [m].
    """
    square = lx * lx + ly * ly + lz * lz
    # Battin's form of the difference of two nearly equal pulls: no cancellation at metres against thousands of km
    q = (rx * (rx + 2.0 * lx) + ry * (ry + 2.0 * ly) + rz * (rz + 2.0 * lz)) / square
    factor = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) ** 1.5)
    scale = -mu / (square**1.5 * (1.0 + q) ** 1.5)
    return scale * (rx - factor * lx), scale * (ry - factor * ly), scale * (rz - factor * lz)
