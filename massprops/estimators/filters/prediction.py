"""The filter's step in time as plain loops, to be compiled by numba; see `correction`."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import product, turn_between, turned, unit
from massprops.estimators.filters.algebra import upper_factor
from massprops.estimators.filters.components import inertia_of, torque_free
from massprops.estimators.filters.rule import (
    ATTITUDE,
    INERTIA,
    POSITION,
    RATIO,
    VELOCITY,
    Carried,
    Rule,
    Step,
    Turn,
    leading,
    place_error,
)

WIDEST_RATE, WIDEST_TURN, WIDEST_RATIO = 10.0, 3.0, 2.0
"""1-sigma of rates [rad/s], attitude [rad] and k beyond which nothing is known of them: wider is not carried."""
FASTEST = 100.0
"""Largest rate that a mean is allowed to reach [rad/s]."""
BEYOND = 1e9
"""Sum of squares of rates and turns [rad, s] of a propagation that has left all meaning."""


def perturbed(x: np.ndarray, g: float, U: np.ndarray, j: int, additive: bool) -> Turn:
    """The attitude of a sigma point g along row j of U (nd or more, N) from x (POINTS + 3 m,): turned, or with the four components added."""
    q = (x[3], x[4], x[5], x[6])
    if additive:
        return unit(q[0] + g * U[j, 3], q[1] + g * U[j, 4], q[2] + g * U[j, 5], q[3] + g * U[j, 6])
    return turned(q[0], q[1], q[2], q[3], g * U[j, 3], g * U[j, 4], g * U[j, 5])


def bounded(x: np.ndarray, P: np.ndarray, rule: Rule) -> None:
    """Holds the rates of x (POINTS + 3 m,) and the covariance P (N, N) where a long time without measurements would take them past all
    meaning."""
    speed = np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    if not speed <= FASTEST:
        for i in range(3):
            x[i] = x[i] * (FASTEST / speed) if np.isfinite(x[i]) and np.isfinite(speed) else 0.0
    nd = leading(rule)
    for i in range(nd):
        widest = WIDEST_RATE if i < 3 else (WIDEST_TURN if i < nd - INERTIA else WIDEST_RATIO)
        if P[i, i] > widest * widest:
            f = widest / np.sqrt(P[i, i])
            for j in range(P.shape[0]):
                P[i, j] *= f
                P[j, i] *= f


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
    """Rates w [rad/s] and attitude q after a step (dt [s], chaser (10,)), with the inertia of x (POINTS + 3 m,) moved by g along row j of
    U (nd or more, N), from column nf."""
    return torque_free(w, q, inertia_of(x[RATIO] + g * U[j, nf], x[RATIO + 1] + g * U[j, nf + 1]), step[0], steps)


def pairs(
    x: np.ndarray, U: np.ndarray, step: Step, steps: int, rule: Rule, odd: np.ndarray, even: np.ndarray
) -> Carried:
    """Half differences and half sums of the sigma points' rates and attitudes a step later, into odd and even (nd, nf)
    that come as zeros; x: (POINTS + 3 m,); U: (nd or more, N). Returns where the mean goes to: w 3, q 4."""
    nd, nf, gamma, additive = odd.shape[0], odd.shape[1], rule.gamma, rule.additive
    q = (x[3], x[4], x[5], x[6])
    centre = carried((x[0], x[1], x[2]), q, x, U, 0, nf, 0.0, step, steps)
    c0, c1, c2, c3, c4, c5, c6 = centre
    for j in range(nd):
        for side in range(2):
            g = gamma if side == 0 else -gamma
            w = (x[0] + g * U[j, 0], x[1] + g * U[j, 1], x[2] + g * U[j, 2])
            p = perturbed(x, g, U, j, additive)
            x0, x1, x2, p0, p1, p2, p3 = carried(w, p, x, U, j, nf, g, step, steps)
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
    return centre


def turn_covariance(
    P: np.ndarray, U: np.ndarray, odd: np.ndarray, even: np.ndarray, mean: np.ndarray, excess: float
) -> None:
    """The covariance of rates and attitude, and with all else, from the pairs, in P (N, N).

    U: (nd or more, N); odd, even: (nd, nf) as of `pairs`; mean: (nf,) of the pairs; excess: weight of its square.
    """
    n, nd, nf = P.shape[0], odd.shape[0], odd.shape[1]
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


def turn_mean(x: np.ndarray, centre: Carried, mean: np.ndarray, spin: np.ndarray, additive: bool) -> None:
    """Rates and attitude of x (POINTS + 3 m,): where the mean went to and the pairs' mean (nf,), then the chaser's turn, spin (4,), on
    the left."""
    c0, c1, c2, c3, c4, c5, c6 = centre
    if additive:
        q = unit(c3 + mean[3], c4 + mean[4], c5 + mean[5], c6 + mean[6])
    else:
        q = turned(c3, c4, c5, c6, mean[3], mean[4], mean[5])
    if spin[1] != 0.0 or spin[2] != 0.0 or spin[3] != 0.0:
        q = product(spin[0], spin[1], spin[2], spin[3], q[0], q[1], q[2], q[3])
    x[0], x[1], x[2] = c0 + mean[0], c1 + mean[1], c2 + mean[2]
    for i in range(4):
        x[ATTITUDE + i] = q[i]


def move_place(x: np.ndarray, F: np.ndarray, spin: np.ndarray, step: Step) -> None:
    """Position and velocity of x (POINTS + 3 m,) by the transition F (6, 6); spin: (4,); step: (dt [s], chaser (10,))."""
    old = np.empty(6)
    for i in range(3):
        old[i], old[3 + i] = x[POSITION + i], x[VELOCITY + i]
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += F[i, j] * old[j]
        x[POSITION + i] = total


def place_covariance(P: np.ndarray, F: np.ndarray, t: int) -> None:
    """The covariance of position and velocity, whose errors begin at t in P (N, N), by the transition F (6, 6)."""
    old = np.empty(6)
    for c in range(P.shape[0]):
        for j in range(6):
            old[j] = P[t + j, c]
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += F[i, j] * old[j]
            P[t + i, c] = total
    for c in range(P.shape[0]):
        for j in range(6):
            old[j] = P[c, t + j]
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += F[i, j] * old[j]
            P[c, t + i] = total


def propagate(
    x: np.ndarray, P: np.ndarray, step: Step, F: np.ndarray, spin: np.ndarray, noise: np.ndarray, rule: Rule
) -> None:
    """State x (POINTS + 3 m,) and covariance P (N, N) after a step (dt [s], chaser (10,)), in place.

    F: (6, 6) of position and velocity; spin: (4,) on the left of q; noise: (N,) variance a second.
    """
    dt, nd = step[0], leading(rule)
    nf = nd - INERTIA
    speed = np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2) + rule.gamma * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2])
    # where the attitude is lost there is no accuracy to keep
    most = 50 if P[3, 3] > 0.25 * WIDEST_TURN * WIDEST_TURN else 10000
    steps = min(max(1, int(np.ceil(speed * abs(dt) / rule.largest_turn))), most)
    U = P.copy()
    upper_factor(U, nd)
    odd, even = np.zeros((nd, nf)), np.zeros((nd, nf))
    centre = pairs(x, U, step, steps, rule, odd, even)
    c0, c1, c2, c3, c4, c5, c6 = centre
    mean = np.zeros(nf)
    size = c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3 + c4 * c4 + c5 * c5 + c6 * c6
    for j in range(nd):
        for i in range(nf):
            mean[i] += even[j, i] / rule.gamma
            size += odd[j, i] * odd[j, i] + even[j, i] * even[j, i]
    if size < BEYOND:
        turn_covariance(P, U, odd, even, mean, rule.excess)
        # attitude is now carried in the turned frame, rates and attitude first
        turn_mean(x, centre, mean, spin, rule.additive)
        if rule.moving:
            move_place(x, F, spin, step)
            place_covariance(P, F, place_error(rule))
    else:
        # a motion beyond what can be integrated: the state stands still and its doubt grows
        for i in range(3):
            x[i] *= 0.5
    for i in range(P.shape[0]):
        P[i, i] += noise[i] * dt
    bounded(x, P, rule)
