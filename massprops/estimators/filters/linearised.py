"""The update of the iterated extended Kalman filter, in place of the unscented one of `correction`; see `core.compiling`.

The derivatives are half differences of sigma points that lie close to the state, along the rows of U, P = U^T U: exact to
rounding for every channel, with no formula of their own. Where the result shows that the state was too far off for a linear
prediction (after an occlusion, with precise cameras), the measurements are linearised again at the result.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import product
from massprops.estimators.filters.correction import (
    absorb,
    begin_rows,
    gated,
    innovations,
    joint_root,
    move_mean,
    root_of,
    rows_of,
    sigma_rows,
)
from massprops.estimators.filters.rule import ATTITUDE, POINTS, Carried, Rule, ahead, per_feature
from massprops.estimators.filters.sight import axes_in_reference, sight

LOOSE = 10.0
"""The gate's factor while the point of linearisation is still being found."""
NEAR = 0.3
"""Sigmas of a measurement that a linear prediction may be off before the update is done again at its result."""


def turn_mean(x: np.ndarray, centre: Carried, mean: np.ndarray, spin: np.ndarray, additive: bool) -> None:
    """Rates and attitude of x (POINTS + 3 m,): where the mean went to, to first order without the spread's part (mean (nf,) is not
    used), then the chaser's turn, spin (4,)."""
    c0, c1, c2, c3, c4, c5, c6 = centre
    q = (c3, c4, c5, c6)
    if spin[1] != 0.0 or spin[2] != 0.0 or spin[3] != 0.0:
        q = product(spin[0], spin[1], spin[2], spin[3], c3, c4, c5, c6)
    x[0], x[1], x[2] = c0, c1, c2
    for i in range(4):
        x[ATTITUDE + i] = q[i]


def whitened_step(step: np.ndarray, U: np.ndarray) -> np.ndarray:
    """y (N,) with U^T y = step; step: (N,); U: (N or more, N) upper triangular."""
    n = step.shape[0]
    y = np.zeros(n)
    for i in range(n):
        total = step[i]
        for j in range(i):
            total -= U[j, i] * y[j]
        y[i] = total / U[i, i]
    return y


def nonlinearity(
    odd: np.ndarray,
    index: np.ndarray,
    kept: int,
    noise: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    change: np.ndarray,
) -> float:
    """Largest difference, in sigmas, between a measurement predicted anew and its linear prediction.

    odd: (N or more, kept or more) derivatives along the rows of U; index, noise: (kept or more,); before, after: (ny,) predicted at the old
    state and the new one; change: (N,) from one to the other along the rows of U.
    """
    most = 0.0
    for c in range(kept):
        off = after[index[c]] - before[index[c]]
        for j in range(change.shape[0]):
            off -= odd[j, c] * change[j]
        most = max(most, abs(off) / np.sqrt(noise[c]))
    return most


def most_near(value: np.ndarray, spread: np.ndarray, noise: np.ndarray, gate: float) -> bool:
    """Whether at least half of the innovations value (nu,), of variances spread and noise (nu,), are within the gate [sigma]."""
    bad = 0
    for c in range(value.shape[0]):
        if not value[c] * value[c] <= gate * gate * (spread[c] + noise[c]):
            bad += 1
    return bool(2 * bad <= value.shape[0])


def correct(
    x: np.ndarray,
    P: np.ndarray,
    z: np.ndarray,
    variance: np.ndarray,
    attitude: np.ndarray,
    place: np.ndarray,
    eyes: np.ndarray,
    group: np.ndarray,
    rule: Rule,
    tally: np.ndarray,
) -> None:
    """As `correction.correct`, with its shapes."""
    n, m, ny = P.shape[0], (x.shape[0] - POINTS) // 3, z.shape[0]
    every, used, start = rows_of(z, variance, m, eyes.shape[0], rule)
    nu = every.shape[0]
    if nu == 0:
        return
    U, mid = root_of(P), axes_in_reference(x)
    at, y, h0, h1, both = x.copy(), np.zeros(n), np.zeros(ny), np.zeros(ny), np.zeros((2, n + 3, nu))
    T, small, kept = np.zeros((nu, nu + n + 1)), False, nu
    for turn in range(rule.rounds):
        index, begin = every.copy(), start.copy()
        both[:] = 0.0
        sigma_rows(both, U, at, mid, False, eyes, (index, begin, used), rule, h0)
        both[1] = 0.0
        mean, value, spread, noise = innovations(both, z, variance, h0, mid, attitude, index, rule)
        for c in range(nu):
            for j in range(n):
                value[c] += both[0, j, c] * y[j]
        # where most disagree the state is still far off: what they say then moves the point of linearisation
        strict = turn == rule.rounds - 1 or not rule.gate > 0.0 or most_near(value, spread, noise, rule.gate)
        kept, inflate = nu, 1.0
        if rule.gate > 0.0:
            kept, inflate = gated(
                both, index, value, noise, mean, spread, group, rule.gate * (1.0 if strict else LOOSE)
            )
        if kept < nu:
            begin_rows(index, kept, ahead(rule), per_feature(eyes.shape[0], rule), begin)
        if kept == 0:
            break
        T, small = joint_root(both, U, begin, mean, value, noise, kept, inflate, rule)
        step = np.zeros(n)
        for c in range(kept):
            for b in range(n):
                step[b] += T[c, kept + n] * T[c, kept + b]
        if not np.isfinite(np.sum(step)):
            break
        at[:] = x
        move_mean(at, step, rule)
        new = whitened_step(step, U)
        sight(h1, used, 0, at, eyes, mid, False, rule)
        near = nonlinearity(both[0], index, kept, noise, h0, h1, new - y) < NEAR
        y[:] = new
        if near and strict:
            break
    tally[2] += nu - kept
    if kept > 0:
        absorb(x, P, T, small, rule, tally)
