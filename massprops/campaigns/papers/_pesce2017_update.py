"""Measurement update of the EKF and the iterated EKF, batched over runs.

The update seeks the most probable state given the prediction and the measurements (Gauss-Newton; the first step alone
is the EKF). It works on y with error = S y, P = S S^T, where the problem is I + A^T A: never ill-conditioned however
sharp a measurement or wide a prior. Each step must lower the cost or is halved, and it ends when what is left to gain
is small against the posterior covariance; the paper's 1 % of the norm of a state in mixed units (62 m of position)
stops while features are still off by many sigmas, and claims the covariance of having arrived.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from massprops.campaigns.papers._pesce2017_state import Layout, State, difference, retract

Observe = Callable[[State, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""`observe(state, runs)`: residuals measured less predicted (b, rows) and derivatives of the predicted (b, rows, n) for
the runs numbered `runs` (b,); anything where nothing was measured."""

JITTER = 1e-13
"""Added to a correlation matrix, so that rounding leaves it positive."""
SMALLEST_STEP = 1.0 / 64.0
"""Share of a step below which a search ends."""


@dataclass(frozen=True)
class Rule:
    """How an update iterates.

    Attributes:
        iterations: at most this many linearisations; 1 is the EKF.
        tolerance: largest step, in posterior sigmas, that counts as arrived.
        paper: stop as the paper does, when the state's norm changes by less than this fraction; no step control.
    """

    iterations: int = 10
    tolerance: float = 0.01
    paper: float | None = None


IEKF = Rule()


@dataclass(frozen=True)
class Updated:
    """state; P (B, n, n); cost: (B,) squared residual of measurements and prior at the answer; iterations: (B,)."""

    state: State
    P: np.ndarray
    cost: np.ndarray
    iterations: np.ndarray


def square_root(P: np.ndarray) -> np.ndarray:
    """S (B, n, n) with P = S S^T for covariances that may be singular to rounding."""
    n = P.shape[-1]
    scale = np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 1e-200))
    correlation = P / (scale[:, :, None] * scale[:, None, :]) + JITTER * np.eye(n)
    try:
        return np.asarray(scale[:, :, None] * np.linalg.cholesky(correlation))
    except np.linalg.LinAlgError:
        pass
    out = np.empty_like(P)
    for b in range(len(P)):
        try:
            out[b] = np.linalg.cholesky(correlation[b])
        except np.linalg.LinAlgError:
            value, vector = np.linalg.eigh(correlation[b])
            out[b] = vector * np.sqrt(np.maximum(value, JITTER))
    return scale[:, :, None] * out


def update(
    layout: Layout,
    state: State,
    P: np.ndarray,
    observe: Observe,
    sigma: np.ndarray,
    rule: Rule = IEKF,
    bend: tuple[np.ndarray, np.ndarray] | None = None,
    begin: State | None = None,
) -> Updated:
    """State and covariance after the measurements of one epoch.

    Args:
        sigma: (B, rows) 1-sigma of each measurement, infinite where there is none.
        bend: mean and variance (B, rows) of the measurement's second order over the prior, for an EKF
            (`curvature.image_curvature`).
        begin: where an iterated update starts to look, in place of the prediction.
    """
    B, n = P.shape[:2]
    if bend is not None:
        observe, sigma = _bent(observe, bend[0]), np.sqrt(sigma**2 + bend[1])
    S = square_root(P)
    weight = np.where(np.isfinite(sigma), 1.0 / sigma, 0.0)
    y = np.zeros((B, n))
    now = state
    if begin is not None:
        y, now = np.linalg.solve(S, difference(layout, begin, state)[..., None])[..., 0], begin
    residual, A = _whitened(observe, now, np.arange(B), weight, S)
    cost = np.sum(residual**2, axis=-1) + np.sum(y**2, axis=-1)
    if rule.iterations == 1:
        step, _ = _newton(A, residual, y)
        return Updated(retract(layout, state, _apply(S, step)), _posterior(S, A), cost, np.ones(B, int))
    step, gain = _newton(A, residual, y)
    size, count, active = np.ones(B), np.ones(B, int), np.ones(B, bool)
    for _ in range(3 * rule.iterations):
        runs = np.flatnonzero(active)
        if not len(runs):
            break
        trial = y[runs] + size[runs, None] * step[runs]
        there = retract(layout, state.take(runs), _apply(S[runs], trial))
        res, slope = _whitened(observe, there, runs, weight[runs], S[runs])
        value = np.sum(res**2, axis=-1) + np.sum(trial**2, axis=-1)
        better = np.isfinite(value) if rule.paper else value <= cost[runs] * (1 + 1e-12) + 1e-12
        size[runs[~better]] *= 0.5
        active[runs[size[runs] < SMALLEST_STEP]] = False
        took = runs[better]
        if not len(took):
            continue
        before = now.take(took)
        y[took], cost[took], A[took] = trial[better], value[better], slope[better]
        now = now.put(took, there.take(better))
        step[took], gain[took] = _newton(slope[better], res[better], trial[better])
        size[took] = 1.0
        count[took] += 1
        near = gain[took] < rule.tolerance**2
        arrived = _change(before, now.take(took)) < rule.paper if rule.paper else near
        active[took[arrived | (count[took] > rule.iterations)]] = False
    return Updated(now, _posterior(S, A), cost, count)


def _bent(observe: Observe, mean: np.ndarray) -> Observe:
    """`observe`, less the mean (B, rows) of the measurement's second order."""

    def corrected(state: State, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, H = observe(state, runs)
        return residual - mean[runs], H

    return corrected


def _whitened(
    observe: Observe, state: State, runs: np.ndarray, weight: np.ndarray, S: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    residual, H = observe(state, runs)
    residual = np.where(weight > 0, residual, 0.0) * weight
    return residual, (np.where(weight[..., None] > 0, H, 0.0) * weight[..., None]) @ S


def _newton(A: np.ndarray, residual: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The step (B, n) and its squared length in posterior sigmas (B,)."""
    At = np.swapaxes(A, -1, -2)
    M = At @ A + np.eye(A.shape[-1])
    downhill = (At @ residual[..., None])[..., 0] - y
    step = np.linalg.solve(M, downhill[..., None])[..., 0]
    return step, np.sum(step * downhill, axis=-1)


def _posterior(S: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Joseph's form in whitened coordinates: with K = C A^T, (1 - KA)(1 - KA)^T + K K^T = C (1 + A^T A) C, symmetric and
    insensitive to first order to errors of the inverse C."""
    M = np.swapaxes(A, -1, -2) @ A + np.eye(A.shape[-1])
    C = np.linalg.inv(M)
    P = S @ (C @ M @ np.swapaxes(C, -1, -2)) @ np.swapaxes(S, -1, -2)
    return np.asarray(0.5 * (P + np.swapaxes(P, -1, -2)))


def _apply(S: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray((S @ y[..., None])[..., 0])


def _change(before: State, after: State) -> np.ndarray:
    """The paper's stopping number: relative change of the norm of (rho, rho_dot, omega, q, P, k)."""

    def norm(s: State) -> np.ndarray:
        parts = (s.r, s.velocity, s.W, s.q, s.body_features.reshape(len(s.r), -1), s.k)
        return np.sqrt(sum(np.sum(p * p, axis=-1) for p in parts))

    return np.abs(norm(after) - norm(before)) / norm(before)
