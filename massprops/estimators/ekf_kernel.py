"""The error-state EKF of hu2024 section 4, compiled; import it late.

The state is the attitude of the unique principal frame T (to inertial axes), the angular velocity in T, k1 and k2, the
turn from T to the body axes of `attitude0`, the relative position and velocity in inertial axes, and the feature
points in T. Errors are ordered as in the offsets below; attitude errors are small turns in the frame's own axes.
The paper's three inertia ratios p are two degrees of freedom: p_x = (I_y - I_z) / I_x and so on follow from k1, k2.
"""

from __future__ import annotations

import numba
import numpy as np

from massprops.estimators.compiled import (
    differential_gravity,
    euler_acceleration,
    matrix_of,
    quaternion_rate,
    turn_between,
    turned,
)

RATE, RATIO, AXES, PLACE, SPEED, POINTS = 3, 6, 8, 11, 14, 17
LARGEST_TURN = 0.05
"""Rotation [rad] per integration step."""
GATE_2 = 13.8
"""Squared Mahalanobis distance in two dimensions that one in a thousand good measurements exceeds."""
GATE_3 = 16.3


@numba.njit(cache=True)
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


@numba.njit(cache=True)
def _step(q, w, k, r, v, h, mu, l0, l1, F):  # type: ignore[no-untyped-def]
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


@numba.njit(cache=True)
def _predict(P, F, h, turn_noise, push_noise):  # type: ignore[no-untyped-def]
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


@numba.njit(cache=True)
def _absorb(P, dx, columns, H, z, R, gate):  # type: ignore[no-untyped-def]
    """One block of rows: measurement minus prediction z, Jacobian H on `columns`, noise R. Returns its normalised
    squared innovation, and whether it passed the gate; an accepted block changes P and the correction dx."""
    D, rows = P.shape[0], len(z)
    PH = np.zeros((D, rows))
    for i in range(D):
        for a in range(rows):
            total = 0.0
            for c in range(len(columns)):
                total += P[i, columns[c]] * H[a, c]
            PH[i, a] = total
    S = R.copy()
    y = z.copy()
    for a in range(rows):
        for c in range(len(columns)):
            y[a] -= H[a, c] * dx[columns[c]]
            for b in range(rows):
                S[a, b] += H[a, c] * PH[columns[c], b]
    inverse = np.linalg.inv(S)
    near = 0.0
    for a in range(rows):
        for b in range(rows):
            near += y[a] * inverse[a, b] * y[b]
    if not near < gate:
        return near, False
    K = PH @ inverse
    for i in range(D):
        for a in range(rows):
            dx[i] += K[i, a] * y[a]
        for j in range(i, D):
            total = P[i, j]
            for a in range(rows):
                total -= K[i, a] * PH[j, a]
            P[i, j] = total
            P[j, i] = total
    return near, True


@numba.njit(cache=True)
def run(
    times,
    q,
    w,
    k,
    axes,
    r,
    v,
    f,
    P,
    lens,
    turn,
    shift,
    uv,
    variance,
    seen_q,
    seen_variance,
    chaser_q,
    chaser,
    mu,
    turn_noise,
    push_noise,
    gated_from,
):  # type: ignore[no-untyped-def]
    """The whole filter, from the state and covariance at the first epoch.

    Args:
        times: (n,). q (4,) T to inertial, w (3,), k (2,), axes (4,) T to body axes, r, v (3,), f (m, 3) in T: the
            state at the first epoch, changed in place; P (D, D), D = 17 + 3 m, changed in place.
        lens (c, 4), turn (c, 3, 3), shift (c, 3): cameras; uv (n, c, m, 2); variance (c,) [px^2].
        seen_q (n, 4) body to cam0, NaN where none; seen_variance (n,) [rad^2].
        chaser_q (n, 4) cam0 to inertial; chaser (n, 3) [m]; mu.
        turn_noise: [rad^2/s^3]; push_noise: [m^2/s^3]; gated_from: epoch from which the gate works.

    Returns:
        out (n, 17 + 2): q 4, w 3, k 2, r 3, v 3, axes 4; sigma (n, 17); passed, refused, sum of squared normalised
        innovations, number of rows.
    """
    n, cams, m = uv.shape[0], uv.shape[1], uv.shape[2]
    D = P.shape[0]
    out, sigma = np.empty((n, 19)), np.empty((n, POINTS))
    F = np.empty((POINTS, POINTS))
    dx = np.zeros(D)
    R, C, B = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    columns, columns3 = np.empty(9, np.int64), np.array([0, 1, 2, AXES, AXES + 1, AXES + 2])
    H, H3 = np.empty((2, 9)), np.zeros((3, 6))
    z, z3 = np.empty(2), np.empty(3)
    R2, R3 = np.zeros((2, 2)), np.zeros((3, 3))
    X, Y, J = np.empty(3), np.empty(3), np.empty((2, 3))
    passed, refused, rows, total = 0, 0, 0, 0.0
    for e in range(n):
        if e > 0:
            gap = times[e] - times[e - 1]
            speed = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            steps = min(2000, max(1, int(np.ceil(speed * gap / LARGEST_TURN))))
            h = gap / steps
            for s in range(steps):
                l0 = chaser[e - 1] + (chaser[e] - chaser[e - 1]) * (s / steps)
                l1 = chaser[e - 1] + (chaser[e] - chaser[e - 1]) * ((s + 1) / steps)
                _step(q, w, k, r, v, h, mu, l0, l1, F)
                _predict(P, F, h, turn_noise, push_noise)
        matrix_of(q[0], q[1], q[2], q[3], R)
        matrix_of(chaser_q[e, 0], chaser_q[e, 1], chaser_q[e, 2], chaser_q[e, 3], C)
        dx[:] = 0.0
        for i in range(m):
            for c in range(cams):
                if not np.isfinite(uv[e, c, i, 0]):
                    continue
                for a in range(3):
                    X[a] = r[a] + R[a, 0] * f[i, 0] + R[a, 1] * f[i, 1] + R[a, 2] * f[i, 2]
                for a in range(3):
                    Y[a] = C[0, a] * X[0] + C[1, a] * X[1] + C[2, a] * X[2] - shift[c, a]
                for a in range(3):
                    X[a] = turn[c, a, 0] * Y[0] + turn[c, a, 1] * Y[1] + turn[c, a, 2] * Y[2]
                if X[2] <= 1e-6:
                    refused += 1
                    continue
                x, y = X[0] / X[2], X[1] / X[2]
                z[0] = uv[e, c, i, 0] - lens[c, 0] * x - lens[c, 2]
                z[1] = uv[e, c, i, 1] - lens[c, 1] * y - lens[c, 3]
                # by the point in inertial axes
                for a in range(3):
                    J[0, a] = J[1, a] = 0.0
                    for b in range(3):
                        du = lens[c, 0] / X[2] * (turn[c, 0, b] - x * turn[c, 2, b])
                        dv = lens[c, 1] / X[2] * (turn[c, 1, b] - y * turn[c, 2, b])
                        J[0, a] += du * C[a, b]
                        J[1, a] += dv * C[a, b]
                for a in range(2):
                    b0 = J[a, 0] * R[0, 0] + J[a, 1] * R[1, 0] + J[a, 2] * R[2, 0]
                    b1 = J[a, 0] * R[0, 1] + J[a, 1] * R[1, 1] + J[a, 2] * R[2, 1]
                    b2 = J[a, 0] * R[0, 2] + J[a, 1] * R[1, 2] + J[a, 2] * R[2, 2]
                    # d(R f) = R (turn x f): row -(b [f x]) = f x b
                    H[a, 0] = f[i, 1] * b2 - f[i, 2] * b1
                    H[a, 1] = f[i, 2] * b0 - f[i, 0] * b2
                    H[a, 2] = f[i, 0] * b1 - f[i, 1] * b0
                    for b in range(3):
                        H[a, 3 + b] = J[a, b]
                    H[a, 6], H[a, 7], H[a, 8] = b0, b1, b2
                for b in range(3):
                    columns[b], columns[3 + b], columns[6 + b] = b, PLACE + b, POINTS + 3 * i + b
                R2[0, 0] = R2[1, 1] = variance[c]
                near, good = _absorb(P, dx, columns, H, z, R2, GATE_2 if e >= gated_from else np.inf)
                if good:
                    passed += 1
                    total += near
                    rows += 2
                else:
                    refused += 1
        if np.isfinite(seen_q[e, 0]):
            # attitude of the body axes: chaser^-1 q axes^-1
            b = _joined(chaser_q[e], q, axes)
            z3[0], z3[1], z3[2] = turn_between(
                b[0], b[1], b[2], b[3], seen_q[e, 0], seen_q[e, 1], seen_q[e, 2], seen_q[e, 3]
            )
            matrix_of(axes[0], axes[1], axes[2], axes[3], B)
            for a in range(3):
                for c in range(3):
                    H3[a, c], H3[a, 3 + c] = B[a, c], -B[a, c]
                R3[a, a] = seen_variance[e]
            near, good = _absorb(P, dx, columns3, H3, z3, R3, GATE_3 if e >= gated_from else np.inf)
            if good:
                passed += 1
                total += near
                rows += 3
            else:
                refused += 1
        q[0], q[1], q[2], q[3] = turned(q[0], q[1], q[2], q[3], dx[0], dx[1], dx[2])
        axes[0], axes[1], axes[2], axes[3] = turned(
            axes[0], axes[1], axes[2], axes[3], dx[AXES], dx[AXES + 1], dx[AXES + 2]
        )
        for a in range(3):
            w[a] += dx[RATE + a]
            r[a] += dx[PLACE + a]
            v[a] += dx[SPEED + a]
            for i in range(m):
                f[i, a] += dx[POINTS + 3 * i + a]
        k[0] += dx[RATIO]
        k[1] += dx[RATIO + 1]
        out[e, 0:4], out[e, 4:7], out[e, 7:9], out[e, 9:12], out[e, 12:15], out[e, 15:19] = q, w, k, r, v, axes
        for a in range(POINTS):
            sigma[e, a] = np.sqrt(max(P[a, a], 0.0))
    return out, sigma, passed, refused, total, rows


@numba.njit(cache=True)
def _joined(c, q, a):  # type: ignore[no-untyped-def]
    """c^-1 q a^-1 of unit quaternions (4,)."""
    b = np.empty(4)
    b[0] = c[0] * q[0] + c[1] * q[1] + c[2] * q[2] + c[3] * q[3]
    b[1] = c[0] * q[1] - c[1] * q[0] - c[2] * q[3] + c[3] * q[2]
    b[2] = c[0] * q[2] + c[1] * q[3] - c[2] * q[0] - c[3] * q[1]
    b[3] = c[0] * q[3] - c[1] * q[2] + c[2] * q[1] - c[3] * q[0]
    d = np.empty(4)
    d[0] = b[0] * a[0] + b[1] * a[1] + b[2] * a[2] + b[3] * a[3]
    d[1] = -b[0] * a[1] + b[1] * a[0] - b[2] * a[3] + b[3] * a[2]
    d[2] = -b[0] * a[2] + b[1] * a[3] + b[2] * a[0] - b[3] * a[1]
    d[3] = -b[0] * a[3] - b[1] * a[2] + b[2] * a[1] + b[3] * a[0]
    return d
