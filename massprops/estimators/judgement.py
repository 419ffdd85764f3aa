"""Whether an estimate can be believed: the same questions of every method, on what it says of itself.

An estimator's sigmas hold where its model does. Four signs show that it does not (Bar-Shalom, Li and Kirubarajan 2001,
section 5.4: tests of filter consistency), and each is asked of every method that gives what it needs:

1. **Finite.** Nothing that is not a finite number of a possible body is converged, observable or reliable.
2. **Size.** The mean squared innovation, in units of its stated covariance, is near 1.
3. **Whiteness.** What a filter learns at one epoch says nothing of what it will learn at the next. The corrections of
   attitude and rate, from each epoch's estimate carried on by free motion to the next one's, are used: they need no look
   inside the filter. A batch method gives its residuals. Correlated errors are worth fewer measurements, so size and
   correlation count together: white and 4 times as large, or as large as stated and alike over 4 epochs, is the same.
4. **Halves.** What one half of the record says of the inertia agrees with what the whole, or the other half, says. A
   filter's estimate moves between the middle and the end by no more than the variance that it gave up on the way.
5. **Agreement.** The smoother reads every measurement at once and is efficient. Another method that errs more than it
   differs from the smoother by no more than its own covariance (Hausman 1978, theorem 2.1).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.inertia import is_physical, ratios
from massprops.dynamics.quaternion import conjugate, multiply, rotation_vector
from massprops.dynamics.rigid_body import propagate
from massprops.estimators.result import Estimate
from massprops.model.problem import Problem

FARTHEST = 4.9
"""|k| of no real body: moments that differ by a factor of 130 belong to a needle or to a filter that ran away."""
INCOMPLETE = "the model lacks something, which 'massprops diagnose' looks for"
"""What innovations say that are larger than the noise, or alike from epoch to epoch."""
LARGEST_SQUARE = 4.0
"""Mean squared innovation, times the epochs over which it stays alike, beyond which sigmas are short by 2."""
SIGNIFICANT_SIGMAS = 4.0
"""Sigmas by which a correlation must stand out from what as many white numbers give."""
FEWEST = 16
"""Epochs from which a correlation can be told."""
UNLIKELY = 1e-4
"""Probability of halves that lie further apart, below which they contradict each other."""
GIVEN_UP = 0.1
"""Least variance, as a share of that in the middle, that a filter is held to give up over the second half: rounding and
linearisation move an estimate that learns nothing more."""


def judged(estimate: Estimate, problem: Problem) -> Estimate:
    """The estimate with `converged`, `observable` and `reliable` as far as they hold, and why not.

    Args:
        estimate: of one method, with its own word on whether it converged and the motion shows the ratios.
        problem: what it was given.
    """
    estimate = _possible(estimate)
    if not estimate.observable:
        return replace(without_ratios(estimate), reliable=False, because=estimate.reason)
    if not estimate.converged:
        return replace(estimate, reliable=False, because=estimate.reason)
    because = _size(estimate, problem) or _halves(estimate)
    return replace(estimate, reliable=not because, because=because)


def without_ratios(estimate: Estimate) -> Estimate:
    """The estimate of a motion that does not show the ratios."""
    return replace(estimate, k1=None, k2=None, k_covariance=None, principal_axes=None, axes_covariance=None)


def against(estimate: Estimate, reference: Estimate) -> Estimate:
    """The estimate, unreliable where it contradicts a reliable reference (the smoother, on the same data)."""
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    if not (estimate.reliable and reference.reliable) or estimate.k_covariance is None:
        return estimate
    assert estimate.k1 is not None and estimate.k2 is not None and reference.k1 is not None and reference.k2 is not None
    apart = np.array([estimate.k1 - reference.k1, estimate.k2 - reference.k2])
    square = float(apart @ np.linalg.pinv(estimate.k_covariance, hermitian=True) @ apart)
    if chdtrc(2, square) >= UNLIKELY:
        return estimate
    because = (
        f"its ratios lie {np.sqrt(square):.1f} of its own sigmas from those of {reference.name}, which reads all "
        "measurements at once: its sigmas are too small"
    )
    return replace(estimate, reliable=False, because=because)


def _possible(estimate: Estimate) -> Estimate:
    """Neither converged nor observable where the numbers are not finite or no body's."""
    values = [estimate.k1, estimate.k2, estimate.inertia, estimate.k_covariance, estimate.w, estimate.q]
    if estimate.observable and (estimate.k1 is None or estimate.k2 is None):
        return _refused(estimate, "it gives no ratios")
    if not all(np.isfinite(np.asarray(v, float)).all() for v in values if v is not None):
        return _refused(estimate, "its result is not finite")
    if estimate.k_covariance is not None and np.diag(estimate.k_covariance).min() < 0:
        return _refused(estimate, "its covariance has negative variances")
    if not estimate.observable:
        return estimate
    assert estimate.k1 is not None and estimate.k2 is not None
    if max(abs(estimate.k1), abs(estimate.k2)) > FARTHEST:
        return _refused(
            estimate, f"the ratios ran away (k1 {estimate.k1:.1f}, k2 {estimate.k2:.1f}): the motion hardly shows them"
        )
    if estimate.inertia is not None:
        if not is_physical(np.linalg.eigvalsh(estimate.inertia), 1e-6):
            return _refused(estimate, "its inertia breaks the triangle inequality")
        if estimate.principal_axes is None:
            estimate = replace(estimate, principal_axes=ratios(estimate.inertia)[1])
    return estimate


def _refused(estimate: Estimate, why: str) -> Estimate:
    """An estimate whose numbers mean nothing."""
    reason = estimate.reason if estimate.reason and not estimate.converged else why
    return replace(estimate, converged=False, observable=False, reason=reason)


def _size(estimate: Estimate, problem: Problem) -> str:
    """Why the innovations contradict their covariance; empty when they do not."""
    if estimate.innovation is None:
        return ""
    memory = 1.0
    series = estimate.residuals if estimate.residuals is not None else corrections(estimate, problem)
    if series is not None and not estimate.memory_counted:
        memory = memory_of(series)
    if estimate.innovation * memory <= LARGEST_SQUARE:
        return ""
    size = f"{np.sqrt(estimate.innovation):.2g} times as large as the stated noise allows"
    if memory == 1.0:
        return f"the innovations are {size}: {INCOMPLETE}"
    return (
        f"the innovations are {size} and are correlated over {memory:.0f} epochs, so the sigmas are about "
        f"{np.sqrt(estimate.innovation * memory):.1f} times too small: {INCOMPLETE}"
    )


def memory_of(series: np.ndarray) -> float:
    """Over how many epochs a series (n, c) of signed numbers, NaN where there is none, stays alike; 1 for white noise.

    1 + 2 sum of its correlations, as long as they stand out (Geyer 1992's initial positive sequence).
    """
    there = np.isfinite(series)
    x = np.where(there, series, 0.0)
    count = int(there.sum())
    if len(series) < FEWEST or not count or not (x * x).sum() > 0:
        return 1.0
    square = float((x * x).sum()) / count
    memory = 1.0
    for lag in range(1, len(series) // 4):
        pairs = int((there[lag:] & there[:-lag]).sum())
        if pairs < FEWEST:
            break
        r = float((x[lag:] * x[:-lag]).sum()) / pairs / square
        if r * np.sqrt(pairs) < SIGNIFICANT_SIGMAS:
            break
        memory += 2.0 * r
    return memory


def corrections(estimate: Estimate, problem: Problem) -> np.ndarray | None:
    """(n, 6) what each epoch's measurements changed of a filter's attitude and rate, over the root mean square of each.

    The second half of the record alone: before, a filter's gain falls from epoch to epoch. None for methods without a
    history of the ratios.
    """
    if estimate.k_history is None or estimate.q is None or estimate.w is None or estimate.principal_axes is None:
        return None
    rows = np.arange(len(estimate.times) // 2, len(estimate.times))
    step = np.diff(estimate.times[rows])
    if len(rows) < FEWEST or not (step > 0).all():
        return None
    at = np.clip(np.searchsorted(problem.times, estimate.times[rows] - 1e-9), 0, len(problem.times) - 1)
    q = multiply(chaser_path(problem.environment, problem.times).q[at], estimate.q[rows])
    w, k = estimate.w[rows], estimate.k_history[rows]
    moments = np.exp(np.stack([k[:, 0], 0.0 * k[:, 0], -k[:, 1]], axis=1))
    axes = estimate.principal_axes
    inertia = (axes * moments[:, None, :]) @ axes.T
    # free motion scales: a step of one with the rates times the step's length
    carried, rate = propagate(q[:-1], w[:-1] * step[:, None], inertia[:-1], np.array([0.0, 1.0]))
    out = np.concatenate(
        [rotation_vector(multiply(conjugate(carried[1]), q[1:])), w[1:] - rate[1] / step[:, None]], axis=1
    )
    scale = np.sqrt(np.mean(out**2, axis=0))
    return out / np.where(scale > 0, scale, 1.0) if np.isfinite(out).all() else None


def _halves(estimate: Estimate) -> str:
    """Why parts of the record contradict each other; empty when they do not."""
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    if estimate.halves is not None:
        (a, A), (b, B) = estimate.halves
        apart, spread, what = a - b, A + B, "the two halves of the record give different inertias"
    elif estimate.k_history is not None and estimate.k_sigma_history is not None and len(estimate.k_history) >= FEWEST:
        k, sigma = estimate.k_history, estimate.k_sigma_history
        middle = len(k) // 2
        apart, before = k[-1] - k[middle], sigma[middle] ** 2
        spread = np.diag(np.maximum(before - sigma[-1] ** 2, GIVEN_UP * before))
        what = "the second half of the record moves the ratios further than the first half's sigmas allow"
    else:
        return ""
    square = float(apart @ np.linalg.pinv(spread, hermitian=True) @ apart)
    p = float(chdtrc(len(apart), square)) if np.isfinite(square) else 0.0
    return f"{what} (p = {p:.1g}): {INCOMPLETE}" if p < UNLIKELY else ""
