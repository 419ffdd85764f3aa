"""Prediction of the error-state EKF of hu2024 section 4, compiled; import it late.

The state is the attitude of the unique principal frame T (to inertial axes), the angular velocity in T, k1 and k2, the
turn from T to the body axes of `attitude0`, the relative position and velocity in inertial axes, and the feature
points in T. Errors are ordered as in the offsets below; attitude errors are small turns in the frame's own axes.
The paper's three inertia ratios p are two degrees of freedom: p_x = (I_y - I_z) / I_x and so on follow from k1, k2.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from massprops.dynamics.compiled import (
    differential_gravity,
    euler_acceleration,
    matrix_of,
    quaternion_rate,
)

RATE, RATIO, AXES, PLACE, SPEED, POINTS = 3, 6, 8, 11, 14, 17
LARGEST_TURN = 0.05
"""Rotation [rad] per integration step."""


@numba.njit(cache=True, error_model="numpy")
def rate_derivatives(w: np.ndarray, k1: float, k2: float, M: np.ndarray, N: np.ndarray) -> None:
    """Euler's equations in the principal frame: writes d(w_dot)/dw (3, 3) and d(w_dot)/dk (3, 2) (hu2024 eq 30)."""
    a, b = np.exp(k1), np.exp(-k2)
    px, py, pz = (1.0 - a) / b, a - b, (b - 1.0) / a
    M[0, 0], M[0, 1], M[0, 2] = 0.0, px * w[2], px * w[1]
    M[1, 0], M[1, 1], M[1, 2] = py * w[2], 0.0, py * w[0]
    M[2, 0], M[2, 1], M[2, 2] = pz * w[1], pz * w[0], 0.0
    N[0, 0], N[0, 1] = -a / b * w[1] * w[2], px * w[1] * w[2]
    N[1, 0], N[1, 1] = a * w[0] * w[2], b * w[0] * w[2]
    N[2, 0], N[2, 1] = -pz * w[0] * w[1], -b / a * w[0] * w[1]


class Slopes(NamedTuple):
    """Derivatives at the four stages of a Runge-Kutta step: attitude (4, 4), rate, position and velocity (4, 3), and of
    rate and turn (4, 3, 5) by rate and ratios at the start."""

    q: np.ndarray
    w: np.ndarray
    r: np.ndarray
    v: np.ndarray
    W: np.ndarray
    T: np.ndarray


@numba.njit(cache=True, error_model="numpy")
def _slope(
    y: np.ndarray, W: np.ndarray, T: np.ndarray, k: np.ndarray, l: np.ndarray, mu: float, s: int, d: Slopes
) -> None:
    """Derivatives at y = (q 4, w 3, r 3, v 3), W and T (3, 5) into stage s of the slopes d; l: the chaser [m]."""
    M, N = np.empty((3, 3)), np.empty((3, 2))
    six = (np.exp(-k[1]), 1.0, np.exp(k[0]), 0.0, 0.0, 0.0)
    d.q[s, 0], d.q[s, 1], d.q[s, 2], d.q[s, 3] = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    d.w[s, 0], d.w[s, 1], d.w[s, 2] = euler_acceleration(six, (y[4], y[5], y[6]), (0.0, 0.0, 0.0))
    for i in range(3):
        d.r[s, i] = y[10 + i]
        d.v[s, i] = 0.0
    if mu > 0.0:
        d.v[s, 0], d.v[s, 1], d.v[s, 2] = differential_gravity(mu, l[0], l[1], l[2], y[7], y[8], y[9])
    rate_derivatives(y[4:7], k[0], k[1], M, N)
    for j in range(5):
        for i in range(3):
            d.W[s, i, j] = M[i, 0] * W[0, j] + M[i, 1] * W[1, j] + M[i, 2] * W[2, j]
            if j >= 3:
                d.W[s, i, j] += N[i, j - 3]
        d.T[s, 0, j] = W[0, j] - (y[5] * T[2, j] - y[6] * T[1, j])
        d.T[s, 1, j] = W[1, j] - (y[6] * T[0, j] - y[4] * T[2, j])
        d.T[s, 2, j] = W[2, j] - (y[4] * T[1, j] - y[5] * T[0, j])


@numba.njit(cache=True, error_model="numpy")
def step(
    q: np.ndarray,
    w: np.ndarray,
    k: np.ndarray,
    r: np.ndarray,
    v: np.ndarray,
    h: float,
    mu: float,
    l0: np.ndarray,
    l1: np.ndarray,
    F: np.ndarray,
) -> None:
    """One Runge-Kutta step of length h in place, and the transition F (17, 17) of the errors."""
    start = q.copy()
    d = Slopes(
        np.empty((4, 4)), np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3, 5)), np.empty((4, 3, 5))
    )
    W, T = np.zeros((3, 5)), np.zeros((3, 5))
    y, l = np.empty(13), np.empty(3)
    for s in range(4):
        c = 0.0 if s == 0 else (1.0 if s == 3 else 0.5)
        before = max(s - 1, 0)
        for i in range(4):
            y[i] = q[i] + c * h * d.q[before, i] if s > 0 else q[i]
        for i in range(3):
            y[4 + i] = w[i] + c * h * d.w[before, i] if s > 0 else w[i]
            y[7 + i] = r[i] + c * h * d.r[before, i] if s > 0 else r[i]
            y[10 + i] = v[i] + c * h * d.v[before, i] if s > 0 else v[i]
            l[i] = l0[i] + c * (l1[i] - l0[i])
            for j in range(5):
                W[i, j] = 1.0 if i == j else 0.0
                T[i, j] = 0.0
                if s > 0:
                    W[i, j] = W[i, j] + c * h * d.W[before, i, j]
                    T[i, j] = T[i, j] + c * h * d.T[before, i, j]
        _slope(y, W, T, k, l, mu, s, d)
    size = 0.0
    for i in range(4):
        q[i] += h / 6 * (d.q[0, i] + 2 * d.q[1, i] + 2 * d.q[2, i] + d.q[3, i])
        size += q[i] * q[i]
    for i in range(4):
        q[i] /= np.sqrt(size)
    for i in range(3):
        w[i] += h / 6 * (d.w[0, i] + 2 * d.w[1, i] + 2 * d.w[2, i] + d.w[3, i])
        r[i] += h / 6 * (d.r[0, i] + 2 * d.r[1, i] + 2 * d.r[2, i] + d.r[3, i])
        v[i] += h / 6 * (d.v[0, i] + 2 * d.v[1, i] + 2 * d.v[2, i] + d.v[3, i])
    _transition(start, q, h, mu, l0, d, F)


@numba.njit(cache=True, error_model="numpy")
def _transition(
    before: np.ndarray, after: np.ndarray, h: float, mu: float, l0: np.ndarray, d: Slopes, F: np.ndarray
) -> None:
    """Writes the transition of the errors over a step from attitude `before` to `after`, with the slopes d."""
    F[:] = 0.0
    for i in range(POINTS):
        F[i, i] = 1.0
    R0, R1 = np.empty((3, 3)), np.empty((3, 3))
    matrix_of(before[0], before[1], before[2], before[3], R0)
    matrix_of(after[0], after[1], after[2], after[3], R1)
    for i in range(3):
        for j in range(3):
            F[i, j] = R1[0, i] * R0[0, j] + R1[1, i] * R0[1, j] + R1[2, i] * R0[2, j]
        for j in range(5):
            F[i, RATE + j] = h / 6 * (d.T[0, i, j] + 2 * d.T[1, i, j] + 2 * d.T[2, i, j] + d.T[3, i, j])
            F[RATE + i, RATE + j] = (1.0 if i == j else 0.0) + h / 6 * (
                d.W[0, i, j] + 2 * d.W[1, i, j] + 2 * d.W[2, i, j] + d.W[3, i, j]
            )
        F[PLACE + i, SPEED + i] = h
    if mu > 0.0:
        square = l0[0] * l0[0] + l0[1] * l0[1] + l0[2] * l0[2]
        pull = mu / square**1.5
        for i in range(3):
            for j in range(3):
                G = pull * (3.0 * l0[i] * l0[j] / square - (1.0 if i == j else 0.0))
                F[PLACE + i, PLACE + j] += G * h * h / 2
                F[PLACE + i, SPEED + j] += G * h * h * h / 6
                F[SPEED + i, PLACE + j] += G * h
                F[SPEED + i, SPEED + j] += G * h * h / 2


@numba.njit(cache=True, error_model="numpy")
def predict(P: np.ndarray, F: np.ndarray, h: float, turn_noise: float, push_noise: float) -> None:
    """P <- F P F^T + Q; only the rows of attitude, rate, place and speed change."""
    D = P.shape[0]
    column = np.empty(POINTS)
    for side in range(2):
        for j in range(D):
            for i in range(POINTS):
                column[i] = P[i, j] if side == 0 else P[j, i]
            for i in range(RATIO):
                total = 0.0
                for m in range(AXES):
                    total += F[i, m] * column[m]
                if side == 0:
                    P[i, j] = total
                else:
                    P[j, i] = total
            for i in range(PLACE, POINTS):
                total = 0.0
                for m in range(PLACE, POINTS):
                    total += F[i, m] * column[m]
                if side == 0:
                    P[i, j] = total
                else:
                    P[j, i] = total
    for i in range(3):
        for first, noise in ((0, turn_noise), (PLACE, push_noise)):
            a, b = first + i, first + 3 + i
            P[a, a] += noise * h * h * h / 3
            P[a, b] += noise * h * h / 2
            P[b, a] += noise * h * h / 2
            P[b, b] += noise * h
