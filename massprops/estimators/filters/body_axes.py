"""The inertia in any body axes, five numbers in place of k1 and k2: in place of what `rule` and `prediction` have.

The numbers are those of `inertia.cholesky_inertia`. Principal axes turn without bound as two moments approach each other, and a
filter whose axes they are takes the linear part of that turn for knowledge; here nothing is singular for any body.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from massprops.dynamics.kernels import cross, symmetric_times
from massprops.estimators.filters.components import torque_free
from massprops.estimators.filters.rule import Carried, Step, Turn

Six: TypeAlias = tuple[float, float, float, float, float, float]
"""Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""
INERTIA = 5
RATIO, AXES, POSITION, VELOCITY, POINTS = 7, 12, 16, 19, 22
"""As in `rule`."""


def six_elements(a: float, b: float, c1: float, c2: float, c3: float) -> Six:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz of the five numbers (see `inertia.cholesky_inertia`)."""
    d1, d3 = np.exp(a), np.exp(-b)
    xy, xz = c1 * d1, c2 * d1
    return d1, c1 * xy + 1.0, c2 * xz + c3 * c3 + d3, xy, xz, c1 * xz + c3


def inertia_of(a: float, b: float, c1: float, c2: float, c3: float) -> tuple[float, ...]:
    """As `components.inertia_of`: the six elements of the inertia, then those of its inverse, L^-T D^-1 L^-1."""
    xx, yy, zz, xy, xz, yz = six_elements(a, b, c1, c2, c3)
    i1, i3, e = np.exp(-a), np.exp(b), c1 * c3 - c2
    diagonal = (i1 + c1 * c1 + e * e * i3, 1.0 + c3 * c3 * i3, i3)
    beside = (-c1 - e * c3 * i3, e * i3, -c3 * i3)
    return (xx, yy, zz, xy, xz, yz, *diagonal, *beside)


def acceleration(inertia: tuple[float, ...], wx: float, wy: float, wz: float) -> tuple[float, float, float]:
    """Angular acceleration without torque, of an inertia as `inertia_of` gives it."""
    a, b, c, d, e, f, ia, ib, ic, i_d, ie, i_f = inertia
    hx, hy, hz = symmetric_times(a, b, c, d, e, f, wx, wy, wz)
    gx, gy, gz = cross(hx, hy, hz, wx, wy, wz)
    return symmetric_times(ia, ib, ic, i_d, ie, i_f, gx, gy, gz)


def carried(
    w: tuple[float, float, float],
    q: Turn,
    x: np.ndarray,
    U: np.ndarray,
    j: int,
    nf: int,
    g: float,
    step: Step,
    steps: int,
) -> Carried:
    """As `prediction.carried`, with its shapes."""
    inertia = inertia_of(
        x[RATIO] + g * U[j, nf],
        x[RATIO + 1] + g * U[j, nf + 1],
        x[RATIO + 2] + g * U[j, nf + 2],
        x[RATIO + 3] + g * U[j, nf + 3],
        x[RATIO + 4] + g * U[j, nf + 4],
    )
    return torque_free(w, q, inertia, step[0], steps)
