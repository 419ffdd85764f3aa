"""The first epochs as one measurement of the state before them: where a filter of the EKF kind can begin linearly.

A first image that places features hardly better than the prior gives depths and rates only as a product (a shallow body
that turns fast looks like a deep one that turns slowly). A filter draws its line through that curve at the first epoch
and never moves it; epochs fitted together move it until all agree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from massprops.estimators.extended.error_state import Layout, State, mirrored
from massprops.estimators.extended.update import Observe, Rule, Updated, update

Ahead = Callable[[int, State], tuple[State, np.ndarray]]
"""`ahead(i, state)`: the state at epoch i from that at epoch i - 1 (epoch 0: from the start), and the transition."""

ROUNDS = 30


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
    (`error_state.mirrored`). The motion counts as exact over the window.

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
