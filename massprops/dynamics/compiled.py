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


def bind(function: Callable[..., Any], **names: Callable[..., Any]) -> Callable[..., Any]:
    """`calling`, compiled."""
    bound: Callable[..., Any] = numba.njit(calling(function, **names), error_model="numpy")
    return bound


euler_acceleration = bind(
    kernels.euler_acceleration,
    cross=cross,
    symmetric_times=symmetric_times,
    symmetric_solve=symmetric_solve,
)
to_body = bind(kernels.to_body, cross=cross)
to_reference = bind(kernels.to_reference, cross=cross)
turned = bind(kernels.turned, product=numba.njit(kernels.product))
unit = numba.njit(kernels.unit)


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
