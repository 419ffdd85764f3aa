"""The filter's step in time as plain loops, to be compiled by numba; see `correction`."""

from __future__ import annotations

import numpy as np

from massprops.estimators.unscented.algebra import upper_factor
from massprops.estimators.unscented.components import torque_free, turn_between, turned, unit

WIDEST_RATE, WIDEST_TURN, WIDEST_RATIO = 10.0, 3.0, 2.0
"""1-sigma of rates [rad/s], attitude [rad] and k beyond which nothing is known of them: wider is not carried."""
FASTEST = 100.0
"""Largest rate that a mean is allowed to reach [rad/s]."""
BEYOND = 1e9
"""Sum of squares of rates and turns [rad, s] of a propagation that has left all meaning."""


def perturbed(q, ax, ay, az, aw, additive):  # type: ignore[no-untyped-def]
    """A sigma point's attitude: turned, or with the four components added (aw, ax, ay, az)."""
    if additive:
        return unit(q[0] + aw, q[1] + ax, q[2] + ay, q[3] + az)
    return turned(q[0], q[1], q[2], q[3], ax, ay, az)


def bounded(w, P, na):  # type: ignore[no-untyped-def]
    """Holds rates and covariance where a long time without measurements would take them past all meaning."""
    speed = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    if not speed <= FASTEST:
        for i in range(3):
            w[i] = w[i] * (FASTEST / speed) if np.isfinite(w[i]) and np.isfinite(speed) else 0.0
    for i in range(5 + na):
        widest = WIDEST_RATE if i < 3 else (WIDEST_TURN if i < 3 + na else WIDEST_RATIO)
        if P[i, i] > widest * widest:
            f = widest / np.sqrt(P[i, i])
            for j in range(P.shape[0]):
                P[i, j] *= f
                P[j, i] *= f


def propagate(w, q, k, s, r, v, P, dt, F, spin, Q, largest_turn, gamma, excess, additive, axes, moving):  # type: ignore[no-untyped-def]
    """State and covariance dt later, in place."""
    n = P.shape[0]
    na = 4 if additive else 3
    nd, nf = 5 + na, 3 + na
    speed = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2) + gamma * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2])
    # where the attitude is lost there is no accuracy to keep
    most = 50 if P[3, 3] > 0.25 * WIDEST_TURN * WIDEST_TURN else 10000
    steps = min(max(1, int(np.ceil(speed * abs(dt) / largest_turn))), most)
    U = P.copy()
    upper_factor(U, nd)
    c0, c1, c2, c3, c4, c5, c6 = torque_free(w[0], w[1], w[2], q[0], q[1], q[2], q[3], k[0], k[1], dt, steps)
    odd, even = np.zeros((nd, nf)), np.zeros((nd, nf))
    for j in range(nd):
        for side in range(2):
            g = gamma if side == 0 else -gamma
            if additive:
                p0, p1, p2, p3 = perturbed(q, g * U[j, 4], g * U[j, 5], g * U[j, 6], g * U[j, 3], True)
            else:
                p0, p1, p2, p3 = perturbed(q, g * U[j, 3], g * U[j, 4], g * U[j, 5], 0.0, False)
            x0, x1, x2, p0, p1, p2, p3 = torque_free(
                w[0] + g * U[j, 0],
                w[1] + g * U[j, 1],
                w[2] + g * U[j, 2],
                p0,
                p1,
                p2,
                p3,
                k[0] + g * U[j, 3 + na],
                k[1] + g * U[j, 4 + na],
                dt,
                steps,
            )
            half = 0.5 / gamma
            sign = half if side == 0 else -half
            d = (x0 - c0, x1 - c1, x2 - c2)
            for i in range(3):
                odd[j, i] += sign * d[i]
                even[j, i] += half * d[i]
            if additive:
                f = (p0 - c3, p1 - c4, p2 - c5, p3 - c6)
                for i in range(4):
                    odd[j, 3 + i] += sign * f[i]
                    even[j, 3 + i] += half * f[i]
            else:
                a = turn_between(c3, c4, c5, c6, p0, p1, p2, p3)
                for i in range(3):
                    odd[j, 3 + i] += sign * a[i]
                    even[j, 3 + i] += half * a[i]
    mean = np.zeros(nf)
    size = c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3 + c4 * c4 + c5 * c5 + c6 * c6
    for j in range(nd):
        for i in range(nf):
            mean[i] += even[j, i] / gamma
            size += odd[j, i] * odd[j, i] + even[j, i] * even[j, i]
    if not size < BEYOND:
        # a motion beyond what can be integrated: the state stands still and its doubt grows
        for i in range(n):
            P[i, i] += Q[i] * dt
        for i in range(3):
            w[i] *= 0.5
        bounded(w, P, na)
        return
    for a in range(nf):
        for b in range(a, nf):
            total = excess * mean[a] * mean[b]
            for j in range(nd):
                total += odd[j, a] * odd[j, b] + even[j, a] * even[j, b]
            P[a, b] = total
        for b in range(nf, n):
            total = 0.0
            for j in range(min(nd, b + 1)):
                total += odd[j, a] * U[j, b]
            P[a, b] = total
    # attitude is now carried in the turned frame, rates and attitude first
    if additive:
        u = unit(c3 + mean[3], c4 + mean[4], c5 + mean[5], c6 + mean[6])
    else:
        u = turned(c3, c4, c5, c6, mean[3], mean[4], mean[5])
    w[0], w[1], w[2] = c0 + mean[0], c1 + mean[1], c2 + mean[2]
    q[0], q[1], q[2], q[3] = u[0], u[1], u[2], u[3]
    if spin[1] != 0.0 or spin[2] != 0.0 or spin[3] != 0.0:
        q0 = spin[0] * q[0] - spin[1] * q[1] - spin[2] * q[2] - spin[3] * q[3]
        q1 = spin[0] * q[1] + spin[1] * q[0] + spin[2] * q[3] - spin[3] * q[2]
        q2 = spin[0] * q[2] - spin[1] * q[3] + spin[2] * q[0] + spin[3] * q[1]
        q3 = spin[0] * q[3] + spin[1] * q[2] - spin[2] * q[1] + spin[3] * q[0]
        q[0], q[1], q[2], q[3] = q0, q1, q2, q3
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a]
    if moving:
        t = nd + (3 if axes else 0)
        old = np.empty(6)
        for i in range(3):
            old[i], old[3 + i] = r[i], v[i]
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += F[i, j] * old[j]
            if i < 3:
                r[i] = total
            else:
                v[i - 3] = total
        for c in range(n):
            for j in range(6):
                old[j] = P[t + j, c]
            for i in range(6):
                total = 0.0
                for j in range(6):
                    total += F[i, j] * old[j]
                P[t + i, c] = total
        for c in range(n):
            for j in range(6):
                old[j] = P[c, t + j]
            for i in range(6):
                total = 0.0
                for j in range(6):
                    total += F[i, j] * old[j]
                P[c, t + i] = total
    for i in range(n):
        P[i, i] += Q[i] * dt
    bounded(w, P, na)
