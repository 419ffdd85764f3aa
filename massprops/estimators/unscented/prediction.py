"""The filter's step in time as plain loops, to be compiled by numba; see `correction`."""

from __future__ import annotations

import numpy as np

from massprops.estimators.unscented.algebra import upper_factor
from massprops.estimators.unscented.arguments import Moving, Quaternion, Rule
from massprops.estimators.unscented.components import product, torque_free, turn_between, turned, unit

WIDEST_RATE, WIDEST_TURN, WIDEST_RATIO = 10.0, 3.0, 2.0
"""1-sigma of rates [rad/s], attitude [rad] and k beyond which nothing is known of them: wider is not carried."""
FASTEST = 100.0
"""Largest rate that a mean is allowed to reach [rad/s]."""
BEYOND = 1e9
"""Sum of squares of rates and turns [rad, s] of a propagation that has left all meaning."""


def offsets(rule: Rule) -> tuple[int, int, int, int]:
    """How many components the attitude's error has, and where axes, position and features begin in the whole error."""
    na = 4 if rule.additive else 3
    nd = 5 + na
    tr = nd + (3 if rule.axes else 0)
    return na, nd, tr, tr + (6 if rule.moving else 0)


def perturbed(q: np.ndarray, U: np.ndarray, j: int, g: float, additive: bool) -> Quaternion:
    """A sigma point's attitude, g along row j of U: turned, or with the four components added."""
    if additive:
        return unit(q[0] + g * U[j, 3], q[1] + g * U[j, 4], q[2] + g * U[j, 5], q[3] + g * U[j, 6])
    return turned(q[0], q[1], q[2], q[3], g * U[j, 3], g * U[j, 4], g * U[j, 5])


def bounded(w: np.ndarray, P: np.ndarray, na: int) -> None:
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


def step_count(s: Moving, dt: float, rule: Rule) -> int:
    """Runge-Kutta steps that the fastest sigma point needs."""
    w, P = s.w, s.P
    speed = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2) + rule.gamma * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2])
    # where the attitude is lost there is no accuracy to keep
    most = 50 if P[3, 3] > 0.25 * WIDEST_TURN * WIDEST_TURN else 10000
    return min(max(1, int(np.ceil(speed * abs(dt) / rule.largest_turn))), most)


def carried_points(s: Moving, U: np.ndarray, dt: float, rule: Rule) -> tuple[tuple[float, ...], np.ndarray, np.ndarray]:
    """The mean dt later (7,), and half differences and half sums (nd, nf) of the pairs of sigma points about it."""
    na = 4 if rule.additive else 3
    nd, nf = 5 + na, 3 + na
    w, q, k = s.w, s.q, s.k
    steps = step_count(s, dt, rule)
    centre = torque_free((w[0], w[1], w[2]), (q[0], q[1], q[2], q[3]), (k[0], k[1]), dt, steps)
    c0, c1, c2, c3, c4, c5, c6 = centre
    odd, even = np.zeros((nd, nf)), np.zeros((nd, nf))
    half = 0.5 / rule.gamma
    for j in range(nd):
        for side in range(2):
            g = rule.gamma if side == 0 else -rule.gamma
            sign = half if side == 0 else -half
            x0, x1, x2, p0, p1, p2, p3 = torque_free(
                (w[0] + g * U[j, 0], w[1] + g * U[j, 1], w[2] + g * U[j, 2]),
                perturbed(q, U, j, g, rule.additive),
                (k[0] + g * U[j, 3 + na], k[1] + g * U[j, 4 + na]),
                dt,
                steps,
            )
            d = (x0 - c0, x1 - c1, x2 - c2)
            for i in range(3):
                odd[j, i] += sign * d[i]
                even[j, i] += half * d[i]
            if rule.additive:
                f = (p0 - c3, p1 - c4, p2 - c5, p3 - c6)
                for i in range(4):
                    odd[j, 3 + i] += sign * f[i]
                    even[j, 3 + i] += half * f[i]
            else:
                a = turn_between(c3, c4, c5, c6, p0, p1, p2, p3)
                for i in range(3):
                    odd[j, 3 + i] += sign * a[i]
                    even[j, 3 + i] += half * a[i]
    return centre, odd, even


def recombined(
    P: np.ndarray, U: np.ndarray, odd: np.ndarray, even: np.ndarray, mean: np.ndarray, excess: float
) -> None:
    """Writes the carried covariance into P: rates and attitude from the sigma points, the rest as it was."""
    n, (nd, nf) = P.shape[0], odd.shape
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
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a]


def translated(s: Moving, F: np.ndarray, at: int) -> None:
    """Position and velocity, whose errors begin at `at`, by their transition F (6, 6), in place."""
    P, old = s.P, np.empty(6)
    for i in range(3):
        old[i], old[3 + i] = s.position[i], s.velocity[i]
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += F[i, j] * old[j]
        if i < 3:
            s.position[i] = total
        else:
            s.velocity[i - 3] = total
    for side in range(2):
        for c in range(P.shape[0]):
            for j in range(6):
                old[j] = P[at + j, c] if side == 0 else P[c, at + j]
            for i in range(6):
                total = 0.0
                for j in range(6):
                    total += F[i, j] * old[j]
                if side == 0:
                    P[at + i, c] = total
                else:
                    P[c, at + i] = total


def propagate(s: Moving, dt: float, F: np.ndarray, spin: np.ndarray, rule: Rule) -> None:
    """State and covariance dt later, in place."""
    w, q, P = s.w, s.q, s.P
    na, nd, tr, _ = offsets(rule)
    U = P.copy()
    upper_factor(U, nd)
    centre, odd, even = carried_points(s, U, dt, rule)
    c0, c1, c2, c3, c4, c5, c6 = centre
    mean = np.zeros(3 + na)
    size = c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3 + c4 * c4 + c5 * c5 + c6 * c6
    for j in range(nd):
        for i in range(3 + na):
            mean[i] += even[j, i] / rule.gamma
            size += odd[j, i] * odd[j, i] + even[j, i] * even[j, i]
    if not size < BEYOND:
        # a motion beyond what can be integrated: the state stands still and its doubt grows
        for i in range(P.shape[0]):
            P[i, i] += rule.noise[i] * dt
        for i in range(3):
            w[i] *= 0.5
        bounded(w, P, na)
        return
    recombined(P, U, odd, even, mean, rule.excess)
    # attitude is now carried in the turned frame, rates and attitude first
    if rule.additive:
        u = unit(c3 + mean[3], c4 + mean[4], c5 + mean[5], c6 + mean[6])
    else:
        u = turned(c3, c4, c5, c6, mean[3], mean[4], mean[5])
    w[0], w[1], w[2] = c0 + mean[0], c1 + mean[1], c2 + mean[2]
    if spin[1] != 0.0 or spin[2] != 0.0 or spin[3] != 0.0:
        u = product(spin[0], spin[1], spin[2], spin[3], u[0], u[1], u[2], u[3])
    q[0], q[1], q[2], q[3] = u[0], u[1], u[2], u[3]
    if rule.moving:
        translated(s, F, tr)
    for i in range(P.shape[0]):
        P[i, i] += rule.noise[i] * dt
    bounded(w, P, na)
