"""The planet's gravity, in place of what `prediction` has without: for an inertia in `body_axes`.

The planet turns the body by its gradient (volpe2017 eq 18) and pulls it otherwise than the chaser, to every order in their
distance.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import (
    INNER,
    NODES,
    TOTAL,
    cross,
    differential_gravity,
    euler_acceleration,
    quaternion_rate,
    symmetric_times,
    to_body,
    to_reference,
)
from massprops.estimators.filters.body_axes import INERTIA, POSITION, RATIO, VELOCITY, Six, six_elements
from massprops.estimators.filters.rule import Carried, Step, Turn


def slope_under_gravity(y: np.ndarray, six: Six, l: np.ndarray, mu: float, out: np.ndarray) -> None:
    """Rates of y = (q 4, w 3 [rad/s], r 3 [m], v 3 [m/s]), (13,), into out (13,), beside a chaser at l (3,) [m]; mu [m^3/s^2]."""
    out[0], out[1], out[2], out[3] = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    torque = (0.0, 0.0, 0.0)
    out[7], out[8], out[9] = y[10], y[11], y[12]
    out[10] = out[11] = out[12] = 0.0
    if mu > 0.0:
        out[10], out[11], out[12] = differential_gravity(mu, l[0], l[1], l[2], y[7], y[8], y[9])
        px, py, pz = l[0] + y[7], l[1] + y[8], l[2] + y[9]
        square = px * px + py * py + pz * pz
        a, b, c = to_body(y[0], y[1], y[2], y[3], px, py, pz)
        factor = 3.0 * mu / (square * square * np.sqrt(square))
        ha, hb, hc = symmetric_times(six[0], six[1], six[2], six[3], six[4], six[5], a, b, c)
        ta, tb, tc = cross(a, b, c, ha, hb, hc)
        torque = (factor * ta, factor * tb, factor * tc)
    out[4], out[5], out[6] = euler_acceleration(six, (y[4], y[5], y[6]), torque)


def move_under_gravity(y: np.ndarray, s: np.ndarray, dt: float, steps: int, chaser: np.ndarray) -> None:
    """y = (q, w, r, v), (13,), a time dt [s] later, in place, by Runge-Kutta steps of fourth order.

    s: (5,) inertia; chaser: (10,) its place at the start, middle and end of the whole time [m], and mu [m^3/s^2].
    """
    six = six_elements(s[0], s[1], s[2], s[3], s[4])
    k, z, l = np.empty((4, 13)), np.empty(13), np.empty(3)
    h = dt / steps
    for step in range(steps):
        for stage in range(4):
            c = NODES[stage]
            u = (step + c) / steps
            for i in range(3):
                l[i] = (
                    chaser[i] * (1 - u) * (1 - 2 * u)
                    + 4 * chaser[3 + i] * u * (1 - u)
                    + chaser[6 + i] * u * (2 * u - 1)
                )
            for i in range(13):
                z[i] = y[i] + (c * h * k[max(stage - 1, 0), i] if stage > 0 else 0.0)
            slope_under_gravity(z, six, l, chaser[9], k[stage])
        for i in range(13):
            y[i] += h / TOTAL * (k[0, i] + INNER * (k[1, i] + k[2, i]) + k[3, i])
        size = np.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3])
        for i in range(4):
            y[i] /= size


def trajectories(
    times: np.ndarray, y: np.ndarray, s: np.ndarray, chaser: np.ndarray, largest_turn: float
) -> np.ndarray:
    """Motion (b, n, 13) at the times from b states y (b, 13) at the first of them and inertias s (b, 5); chaser: (n, 10) over
    the step that ends at each time. All take the same steps, so that differences between them are smooth."""
    b, n = y.shape[0], len(times)
    out = np.empty((b, n, 13))
    speed = 1.2 * np.sqrt(y[0, 4] ** 2 + y[0, 5] ** 2 + y[0, 6] ** 2)
    for i in range(b):
        z = y[i].copy()
        for j in range(13):
            out[i, 0, j] = z[j]
        for e in range(1, n):
            h = times[e] - times[e - 1]
            steps = int(min(5000.0, max(1.0, np.ceil(speed * h / largest_turn))))
            move_under_gravity(z, s[i], h, steps, chaser[e])
            for j in range(13):
                out[i, e, j] = z[j]
    return out


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
    """As `prediction.carried`, with its shapes; the place from which the gradient is taken is that of the mean."""
    y, s = np.empty(13), np.empty(INERTIA)
    for i in range(INERTIA):
        s[i] = x[RATIO + i] + g * U[j, nf + i]
    y[0], y[1], y[2], y[3] = q
    y[4], y[5], y[6] = w
    for i in range(6):
        y[7 + i] = x[POSITION + i]
    move_under_gravity(y, s, step[0], steps, step[1])
    return y[4], y[5], y[6], y[0], y[1], y[2], y[3]


def move_place(x: np.ndarray, F: np.ndarray, spin: np.ndarray, step: Step) -> None:
    """As `prediction.move_place`, with its shapes, in gravity that is not linear in the distance from the chaser."""
    y = np.zeros(13)
    y[0] = 1.0
    for i in range(6):
        y[7 + i] = x[POSITION + i]
    move_under_gravity(y, np.zeros(INERTIA), step[0], 1, step[1])
    a, b, c, d = spin[0], spin[1], spin[2], spin[3]
    x[POSITION], x[POSITION + 1], x[POSITION + 2] = to_reference(a, b, c, d, y[7], y[8], y[9])
    x[VELOCITY], x[VELOCITY + 1], x[VELOCITY + 2] = to_reference(a, b, c, d, y[10], y[11], y[12])
