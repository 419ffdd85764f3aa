"""The equations of motion compiled: imported late, for importing it loads numba."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba
import numpy as np

from massprops.dynamics import kernels

cross = numba.njit(inline="always")(kernels.cross)
quaternion_rate = numba.njit(inline="always")(kernels.quaternion_rate)
differential_gravity = numba.njit(inline="always")(kernels.differential_gravity)
symmetric_times = numba.njit(kernels.symmetric_times)
# an inertia that ran off to nothing gives no number, not an error
symmetric_solve = numba.njit(kernels.symmetric_solve, error_model="numpy")


def calling(function: Callable[..., Any], **names: Callable[..., Any]) -> Callable[..., Any]:
    """`function` with the functions that it calls replaced by their compiled forms, ready to be compiled."""
    return FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)


def _bind(function: Callable[..., Any], **names: Callable[..., Any]) -> Callable[..., Any]:
    bound: Callable[..., Any] = numba.njit(calling(function, **names), error_model="numpy")
    return bound


euler_acceleration = _bind(
    kernels.euler_acceleration,
    cross=cross,
    symmetric_times=symmetric_times,
    symmetric_solve=symmetric_solve,
)
to_body = _bind(kernels.to_body, cross=cross)
to_reference = _bind(kernels.to_reference, cross=cross)


@numba.njit(cache=True, error_model="numpy")
def turned(
    qw: float, qx: float, qy: float, qz: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """q times the small rotation (x, y, z) [rad] in body axes, as a unit quaternion."""
    square = x * x + y * y + z * z
    if square < 1e-12:
        c, s = 1.0 - square / 8.0, 0.5 - square / 48.0
    else:
        angle = np.sqrt(square)
        c, s = np.cos(angle / 2), np.sin(angle / 2) / angle
    x, y, z = s * x, s * y, s * z
    w = qw * c - qx * x - qy * y - qz * z
    a = qw * x + qx * c + qy * z - qz * y
    b = qw * y - qx * z + qy * c + qz * x
    d = qw * z + qx * y - qy * x + qz * c
    size = np.sqrt(w * w + a * a + b * b + d * d)
    return w / size, a / size, b / size, d / size


@numba.njit(cache=True, error_model="numpy")
def turn_between(
    pw: float, px: float, py: float, pz: float, qw: float, qx: float, qy: float, qz: float
) -> tuple[float, float, float]:
    """The rotation vector v in body axes with q = p exp(v)."""
    w = pw * qw + px * qx + py * qy + pz * qz
    x = pw * qx - px * qw - py * qz + pz * qy
    y = pw * qy + px * qz - py * qw - pz * qx
    z = pw * qz - px * qy + py * qx - pz * qw
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = np.sqrt(x * x + y * y + z * z)
    if sine < 1e-12:
        return 2.0 * x, 2.0 * y, 2.0 * z
    scale = 2.0 * np.arctan2(sine, w) / sine
    return scale * x, scale * y, scale * z


@numba.njit(cache=True, error_model="numpy")
def matrix_of(qw: float, qx: float, qy: float, qz: float, R: np.ndarray) -> None:
    """Writes the rotation matrix of a unit quaternion into R (3, 3)."""
    R[0, 0] = 1 - 2 * (qy * qy + qz * qz)
    R[0, 1] = 2 * (qx * qy - qw * qz)
    R[0, 2] = 2 * (qx * qz + qw * qy)
    R[1, 0] = 2 * (qx * qy + qw * qz)
    R[1, 1] = 1 - 2 * (qx * qx + qz * qz)
    R[1, 2] = 2 * (qy * qz - qw * qx)
    R[2, 0] = 2 * (qx * qz - qw * qy)
    R[2, 1] = 2 * (qy * qz + qw * qx)
    R[2, 2] = 1 - 2 * (qx * qx + qy * qy)
