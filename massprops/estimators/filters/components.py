"""What the filter needs of motion and sight, component by component: numbers (also inside numba) or arrays alike."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.kernels import (
    INNER,
    NODES,
    TOTAL,
    cross,
    principal_acceleration,
    quaternion_rate,
    to_reference,
    unit,
)

N = Any
"""A component: number or array."""


def inertia_of(k1: N, k2: N) -> tuple[N, ...]:
    """What `acceleration` needs of the inertia: in principal axes (I2 - I3)/I1, (I3 - I1)/I2 and (I1 - I2)/I3."""
    i1, i3 = np.exp(k1), np.exp(-k2)
    return (1.0 - i3) / i1, i3 - i1, (i1 - 1.0) / i3


def acceleration(inertia: tuple[N, ...], wx: N, wy: N, wz: N) -> tuple[N, N, N]:
    """Angular acceleration without torque, of an inertia as `inertia_of` gives it."""
    return principal_acceleration(inertia[0], inertia[1], inertia[2], wx, wy, wz)


def torque_free(
    w: tuple[N, N, N], q: tuple[N, N, N, N], inertia: tuple[N, ...], dt: float, steps: int
) -> tuple[N, N, N, N, N, N, N]:
    """Rates and attitude after dt of torque-free motion: `steps` Runge-Kutta steps of fourth order."""
    wx, wy, wz = w
    qw, qx, qy, qz = q
    h = dt / steps
    h2, h3, h4, share = NODES[1] * h, NODES[2] * h, NODES[3] * h, h / TOTAL
    for _ in range(steps):
        ax, ay, az = acceleration(inertia, wx, wy, wz)
        aw, ai, aj, ak = quaternion_rate(qw, qx, qy, qz, wx, wy, wz)
        ux, uy, uz = wx + h2 * ax, wy + h2 * ay, wz + h2 * az
        bx, by, bz = acceleration(inertia, ux, uy, uz)
        bw, bi, bj, bk = quaternion_rate(qw + h2 * aw, qx + h2 * ai, qy + h2 * aj, qz + h2 * ak, ux, uy, uz)
        ux, uy, uz = wx + h3 * bx, wy + h3 * by, wz + h3 * bz
        cx, cy, cz = acceleration(inertia, ux, uy, uz)
        cw, ci, cj, ck = quaternion_rate(qw + h3 * bw, qx + h3 * bi, qy + h3 * bj, qz + h3 * bk, ux, uy, uz)
        ux, uy, uz = wx + h4 * cx, wy + h4 * cy, wz + h4 * cz
        dx, dy, dz = acceleration(inertia, ux, uy, uz)
        dw, di, dj, dk = quaternion_rate(qw + h4 * cw, qx + h4 * ci, qy + h4 * cj, qz + h4 * ck, ux, uy, uz)
        wx = wx + share * (ax + INNER * (bx + cx) + dx)
        wy = wy + share * (ay + INNER * (by + cy) + dy)
        wz = wz + share * (az + INNER * (bz + cz) + dz)
        qw = qw + share * (aw + INNER * (bw + cw) + dw)
        qx = qx + share * (ai + INNER * (bi + ci) + di)
        qy = qy + share * (aj + INNER * (bj + cj) + dj)
        qz = qz + share * (ak + INNER * (bk + ck) + dk)
    qw, qx, qy, qz = unit(qw, qx, qy, qz)
    return wx, wy, wz, qw, qx, qy, qz


def image(eyes: N, c: int, x: N, y: N, z: N, vx: N, vy: N, vz: N) -> tuple[N, N, N, N]:
    """Image position and its rate of a point (x, y, z) moving at (vx, vy, vz) in the chaser's frame, in camera c.

    A point at or behind the camera's plane is held at a small positive depth, so that a stray sigma point stays finite.
    """
    fu, fv, cu, cv = eyes[c, 0], eyes[c, 1], eyes[c, 2], eyes[c, 3]
    r0, r1, r2, r3, r4, r5 = eyes[c, 4], eyes[c, 5], eyes[c, 6], eyes[c, 7], eyes[c, 8], eyes[c, 9]
    r6, r7, r8 = eyes[c, 10], eyes[c, 11], eyes[c, 12]
    dx, dy, dz = x - eyes[c, 13], y - eyes[c, 14], z - eyes[c, 15]
    depth = np.maximum(r6 * dx + r7 * dy + r8 * dz, 1e-3)
    inverse = 1.0 / depth
    u = (r0 * dx + r1 * dy + r2 * dz) * inverse
    v = (r3 * dx + r4 * dy + r5 * dz) * inverse
    receding = (r6 * vx + r7 * vy + r8 * vz) * inverse
    du = (r0 * vx + r1 * vy + r2 * vz) * inverse - u * receding
    dv = (r3 * vx + r4 * vy + r5 * vz) * inverse - v * receding
    return fu * u + cu, fv * v + cv, fu * du, fv * dv


def feature_motion(qw: N, qx: N, qy: N, qz: N, wx: N, wy: N, wz: N, px: N, py: N, pz: N) -> tuple[N, N, N, N, N, N]:
    """A body point seen from the centre of mass in the reference frame, and its velocity."""
    ax, ay, az = to_reference(qw, qx, qy, qz, px, py, pz)
    bx, by, bz = cross(wx, wy, wz, px, py, pz)
    bx, by, bz = to_reference(qw, qx, qy, qz, bx, by, bz)
    return ax, ay, az, bx, by, bz
