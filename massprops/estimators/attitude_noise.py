"""How much attitudes from outside can be believed: those of structure from motion err alike over many frames.

Neighbouring frames share their features, and with them their error: seventy frames may be worth five. A filter that
takes each for new evidence claims sigmas several times too small. Here the errors' correlation is read from what free
motion leaves of the attitudes, by restricted maximum likelihood (Patterson and Thompson 1971), which knows how much of
a slow error the motion's own eleven numbers swallow; each attitude's sigma then grows so that all of them together say
what they are worth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.estimators.start import Start
from massprops.model.problem import Problem

MOST_MEANS = 200
"""Longer records are taken as so many means of neighbouring epochs."""
FEWEST = 24
CORRELATIONS = (0.3, 0.5, 0.65, 0.75, 0.82, 0.88, 0.92, 0.95, 0.97)
"""Of neighbouring errors; slower ones cannot be told from motion."""
WHITE_SHARES = (0.0, 0.2, 0.5)
"""Of the variance, that is new at each epoch."""
EVIDENCE = 4.0
"""Log-likelihood by which correlated errors must explain the residuals better than white ones."""


def with_correlated_noise(problem: Problem, start: Start) -> tuple[Problem, str]:
    """The problem with attitudes' sigmas as wide as they deserve, and one line that says so; as it was, and nothing, where
    their errors are white or too few.

    Args:
        start: `massprops.estimators.start.Start`, of the whole record.
    """
    if start.poses is None or start.body_frame != "attitude0" or len(start.poses.rows) < FEWEST:
        return problem, ""
    residuals_and_slopes = _left(problem, start)
    factor, memory = (1.0, 1.0) if residuals_and_slopes is None else inflation_of(*residuals_and_slopes)
    if not factor > 1.0:
        return problem, ""
    line = f"errors of attitude0 stay alike over about {memory:.0f} epochs: its sigmas are taken {factor:.1f} times as wide"
    return replace(problem, sigma_attitude=problem.sigma_attitude * factor, alike=factor), line


def _left(problem: Problem, start: Start) -> tuple[np.ndarray, np.ndarray] | None:
    """What free motion leaves of the attitudes (n, 3), and its derivatives (n, 3, 11), in stated sigmas."""
    from massprops.dynamics.chaser_path import chaser_path
    from massprops.dynamics.quaternion import multiply
    from massprops.estimators.free_fit import free_fit, left_by

    fit = free_fit(problem, start)
    if fit is None:
        return None
    chaser = chaser_path(problem.environment, problem.times).q[fit.rows]
    sigma = problem.sigma_attitude[fit.rows]
    if not (np.isfinite(sigma) & (sigma > 0)).all():
        return None
    guess = (multiply(chaser[0], fit.q), fit.w, fit.inertia)
    return left_by(problem.times[fit.rows], multiply(chaser, problem.attitude[fit.rows]), sigma, guess)


def inflation_of(left: np.ndarray, slope: np.ndarray) -> tuple[float, float]:
    """By how much sigmas must grow, 1 for white errors, and over how many epochs errors stay alike.

    Args:
        left: (n, 3) residuals in sigmas; slope: (n, 3, p) their derivatives by what was fitted.
    """
    block = int(np.ceil(len(left) / MOST_MEANS))
    count = len(left) // block

    def means(x: np.ndarray) -> np.ndarray:
        return np.asarray(x[: count * block].reshape(count, block, *x.shape[1:]).mean(axis=1))

    r, A = means(left), means(slope)
    A = A / np.maximum(np.sqrt(np.sum(A * A, axis=(0, 1))), 1e-300)
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    plain = _likelihood(np.eye(count), r, A)[0]
    trials = [(plain, 1.0, 1.0)]
    for rho in CORRELATIONS:
        alike = rho**apart
        for white in WHITE_SHARES:
            likelihood, variance = _likelihood((1 - white) * alike + white * np.eye(count), r, A)
            memory = block * (1.0 + 2.0 * (1 - white) * rho / (1 - rho))
            trials.append((likelihood, variance * memory, memory))
    log, square, memory = np.array(trials).T
    if log.max() < plain + EVIDENCE:
        return 1.0, 1.0
    # a short record leaves the memory open: the mean over what is likely
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    return float(np.sqrt(max(weight @ square, 1.0))), float(weight @ memory)


def _likelihood(C: np.ndarray, r: np.ndarray, A: np.ndarray) -> tuple[float, float]:
    """Restricted log-likelihood of residuals with correlation C (n, n) along each axis, and their variance."""
    n, p = len(r), A.shape[2]
    L = np.linalg.cholesky(C)
    white = np.linalg.solve(L, np.concatenate([r[:, :, None], A], axis=2).reshape(n, -1)).reshape(n, 3, p + 1)
    whole = white.reshape(3 * n, p + 1)
    r, A = whole[:, 0], whole[:, 1:]
    normal = A.T @ A
    value, vector = np.linalg.eigh(normal)
    used = value > 1e-10 * value[-1]
    seen = vector[:, used].T @ (A.T @ r)
    square = float(r @ r - np.sum(seen**2 / value[used]))
    degrees = 3 * n - int(used.sum())
    log = -0.5 * degrees * np.log(square / degrees) - 3 * float(np.log(np.diag(L)).sum())
    return log - 0.5 * float(np.log(value[used]).sum()), square / degrees
