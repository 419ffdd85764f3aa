"""The first epochs as one measurement of the state before them: where a filter of the EKF kind can begin linearly.

A first image that places features hardly better than the prior gives depths and rates only as a product (a shallow body
that turns fast looks like a deep one that turns slowly). A filter draws its line through that curve at the first epoch
and never moves it; epochs fitted together move it until all agree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from massprops.campaigns.papers._pesce2017_state import Layout, State, mirrored
from massprops.campaigns.papers._pesce2017_update import Observe, Rule, Updated, update

Ahead = Callable[[int, State], tuple[State, np.ndarray]]
"""`ahead(i, state)`: the state at epoch i from that at epoch i - 1 (epoch 0: from the start), and the transition."""

ROUNDS = 30
"""Steps of one fit at most."""


def update_together(
    layout: Layout,
    state: State,
    P: np.ndarray,
    ahead: Ahead,
    observe: Sequence[Observe],
    sigma: np.ndarray,
    windows: Sequence[int],
) -> Updated:
    """The most probable state at the start and its covariance, from the measurements of the first epochs.

    The window grows, each beginning where the last ended, and both of two mirrored answers are sought in each
    (`_pesce2017_state.mirrored`). The motion counts as exact over the window.

    Args:
        state, P: before the first epoch. observe: of each epoch, residuals and derivatives at that epoch's state.
        sigma: (B, rows) of one epoch, the same for all. windows: numbers of epochs, growing.
    """
    rule, begin, done = Rule(ROUNDS), None, None
    for n in windows:
        whole = _stacked(ahead, observe[:n])
        wide = np.tile(sigma, n)
        done = update(layout, state, P, whole, wide, rule, begin=begin)
        other = update(layout, state, P, whole, wide, rule, begin=mirrored(done.state))
        better = other.cost < done.cost
        covariance = done.P.copy()
        covariance[better] = other.P[better]
        begin = done.state.put(better, other.state.take(better))
        done = Updated(begin, covariance, np.minimum(done.cost, other.cost), done.iterations + other.iterations)
    if done is None:
        raise ValueError("update_together: no window")
    return done


def update_again(
    layout: Layout,
    state: State,
    P: np.ndarray,
    observe: Observe,
    sigma: np.ndarray,
    rule: Rule,
    bend: Callable[[State, np.ndarray], np.ndarray],
    suspect: Callable[[State, np.ndarray], np.ndarray],
) -> Updated:
    """`update`, done again with wider measurements where its own answer is so uncertain that they bend over it.

    There the cost can have two valleys (Necker's reversal: depths mirrored and the turn across the sight reversed give
    nearly the same images), of which the search finds the nearer and its covariance knows nothing of the other: both
    are searched and the deeper one is taken.

    Args:
        bend: variance (b, rows) of the second order over a state and covariance.
        suspect: (b,) True where the bend may matter, quickly told.
    """
    done = update(layout, state, P, observe, sigma, rule)
    runs = np.flatnonzero(suspect(done.state, done.P))
    if not len(runs):
        return done
    before, updated, P0 = state.take(runs), done.state.take(runs), P[runs]

    def own(s: State, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return observe(s, runs[which])

    other = update(layout, before, P0, own, sigma[runs], rule, begin=mirrored(updated))
    better = other.cost < done.cost[runs]
    updated = updated.put(better, other.state.take(better))
    answer = done.P[runs]
    answer[better] = other.P[better]
    wide = np.sqrt(sigma[runs] ** 2 + bend(updated, answer))
    again = update(layout, before, P0, own, wide, rule, begin=updated)
    P, cost, count = done.P.copy(), done.cost.copy(), done.iterations.copy()
    P[runs], cost[runs] = again.P, again.cost
    count[runs] += other.iterations + again.iterations
    return Updated(done.state.put(runs, again.state), P, cost, count)


def _stacked(ahead: Ahead, observe: Sequence[Observe]) -> Observe:
    def whole(state: State, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residuals, slopes, F = [], [], None
        for i, one in enumerate(observe):
            state, step = ahead(i, state)
            F = step if F is None else step @ F
            residual, H = one(state, runs)
            residuals.append(residual)
            slopes.append(H @ F)
        return np.concatenate(residuals, axis=1), np.concatenate(slopes, axis=1)

    return whole
