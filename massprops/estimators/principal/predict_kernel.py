"""Prediction of the error-state EKF of hu2024 section 4, compiled; import it late.

The state is the attitude of the unique principal frame T (to inertial axes), the angular velocity in T, k1 and k2, the
turn from T to the body axes of `attitude0`, the relative position and velocity in inertial axes, and the feature
points in T. Errors are ordered as in the offsets below; attitude errors are small turns in the frame's own axes.
The paper's three inertia ratios p are two degrees of freedom: p_x = (I_y - I_z) / I_x and so on follow from k1, k2.
"""

from __future__ import annotations

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
def rate_derivatives(w, k1, k2, M, N):  # type: ignore[no-untyped-def]
    """Euler's equations in the principal frame: writes d(w_dot)/dw (3, 3) and d(w_dot)/dk (3, 2) (hu2024 eq 30)."""
    a, b = np.exp(k1), np.exp(-k2)
    px, py, pz = (1.0 - a) / b, a - b, (b - 1.0) / a
    M[0, 0], M[0, 1], M[0, 2] = 0.0, px * w[2], px * w[1]
    M[1, 0], M[1, 1], M[1, 2] = py * w[2], 0.0, py * w[0]
    M[2, 0], M[2, 1], M[2, 2] = pz * w[1], pz * w[0], 0.0
    N[0, 0], N[0, 1] = -a / b * w[1] * w[2], px * w[1] * w[2]
    N[1, 0], N[1, 1] = a * w[0] * w[2], b * w[0] * w[2]
    N[2, 0], N[2, 1] = -pz * w[0] * w[1], -b / a * w[0] * w[1]


@numba.njit(cache=True, error_model="numpy")
def step(q, w, k, r, v, h, mu, l0, l1, F):  # type: ignore[no-untyped-def]
    """One Runge-Kutta step of length h in place, and the transition F (17, 17) of the errors."""
    Ix, Iz = np.exp(-k[1]), np.exp(k[0])
    M, N = np.empty((3, 3)), np.empty((3, 2))
    start = q.copy()
    dq, dw, dr, dv = np.empty((4, 4)), np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    dW, dT = np.empty((4, 3, 5)), np.empty((4, 3, 5))
    W, T = np.zeros((3, 5)), np.zeros((3, 5))
    for i in range(3):
        W[i, i] = 1.0
    qs, ws, rs, vs, Ws, Ts = q.copy(), w.copy(), r.copy(), v.copy(), W.copy(), T.copy()
    for s in range(4):
        c = 0.0 if s == 0 else (1.0 if s == 3 else 0.5)
        if s > 0:
            for i in range(4):
                qs[i] = q[i] + c * h * dq[s - 1, i]
            for i in range(3):
                ws[i] = w[i] + c * h * dw[s - 1, i]
                rs[i] = r[i] + c * h * dr[s - 1, i]
                vs[i] = v[i] + c * h * dv[s - 1, i]
                for j in range(5):
                    Ws[i, j] = W[i, j] + c * h * dW[s - 1, i, j]
                    Ts[i, j] = T[i, j] + c * h * dT[s - 1, i, j]
        dq[s, 0], dq[s, 1], dq[s, 2], dq[s, 3] = quaternion_rate(qs[0], qs[1], qs[2], qs[3], ws[0], ws[1], ws[2])
        dw[s, 0], dw[s, 1], dw[s, 2] = euler_acceleration(
            Ix, 1.0, Iz, 0.0, 0.0, 0.0, ws[0], ws[1], ws[2], 0.0, 0.0, 0.0
        )
        for i in range(3):
            dr[s, i] = vs[i]
            dv[s, i] = 0.0
        if mu > 0.0:
            dv[s, 0], dv[s, 1], dv[s, 2] = differential_gravity(
                mu,
                l0[0] + c * (l1[0] - l0[0]),
                l0[1] + c * (l1[1] - l0[1]),
                l0[2] + c * (l1[2] - l0[2]),
                rs[0],
                rs[1],
                rs[2],
            )
        rate_derivatives(ws, k[0], k[1], M, N)
        for j in range(5):
            for i in range(3):
                dW[s, i, j] = M[i, 0] * Ws[0, j] + M[i, 1] * Ws[1, j] + M[i, 2] * Ws[2, j]
                if j >= 3:
                    dW[s, i, j] += N[i, j - 3]
            dT[s, 0, j] = Ws[0, j] - (ws[1] * Ts[2, j] - ws[2] * Ts[1, j])
            dT[s, 1, j] = Ws[1, j] - (ws[2] * Ts[0, j] - ws[0] * Ts[2, j])
            dT[s, 2, j] = Ws[2, j] - (ws[0] * Ts[1, j] - ws[1] * Ts[0, j])
    size = 0.0
    for i in range(4):
        q[i] += h / 6 * (dq[0, i] + 2 * dq[1, i] + 2 * dq[2, i] + dq[3, i])
        size += q[i] * q[i]
    for i in range(4):
        q[i] /= np.sqrt(size)
    for i in range(3):
        w[i] += h / 6 * (dw[0, i] + 2 * dw[1, i] + 2 * dw[2, i] + dw[3, i])
        r[i] += h / 6 * (dr[0, i] + 2 * dr[1, i] + 2 * dr[2, i] + dr[3, i])
        v[i] += h / 6 * (dv[0, i] + 2 * dv[1, i] + 2 * dv[2, i] + dv[3, i])
    F[:] = 0.0
    for i in range(POINTS):
        F[i, i] = 1.0
    R0, R1 = np.empty((3, 3)), np.empty((3, 3))
    matrix_of(start[0], start[1], start[2], start[3], R0)
    matrix_of(q[0], q[1], q[2], q[3], R1)
    for i in range(3):
        for j in range(3):
            F[i, j] = R1[0, i] * R0[0, j] + R1[1, i] * R0[1, j] + R1[2, i] * R0[2, j]
        for j in range(5):
            F[i, RATE + j] = h / 6 * (dT[0, i, j] + 2 * dT[1, i, j] + 2 * dT[2, i, j] + dT[3, i, j])
            F[RATE + i, RATE + j] = (1.0 if i == j else 0.0) + h / 6 * (
                dW[0, i, j] + 2 * dW[1, i, j] + 2 * dW[2, i, j] + dW[3, i, j]
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
def predict(P, F, h, turn_noise, push_noise):  # type: ignore[no-untyped-def]
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
