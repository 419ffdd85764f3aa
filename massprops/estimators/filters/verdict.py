"""What a filter says of its own run, the same questions of every filter: may it be believed, does the motion show the
ratios, are the principal axes determined. `judgement` asks every method what needs no look inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.estimators.attitude_information import shown_by
from massprops.estimators.judgement import FARTHEST, without_ratios
from massprops.estimators.result import Estimate
from massprops.model.problem import Problem

MOST_REFUSED = 0.3
"""Share of refused measurements beyond which it is the filter that is wrong."""
LARGEST_SQUARE = 4.0
"""Mean squared innovation, in units of its covariance, of a filter whose noise is short by 2."""
LEARNT, SHARP = 0.7, 0.05
"""1-sigma of k over that at the start above which, where it is larger than SHARP, the motion taught nothing."""
LEAST_OF_BOUND = 0.65
"""Share of the Cramer-Rao bound of k below which a filter's 1-sigma is false: its linearisation moved, and it took that for
news. Of 160 claims from tracks or attitudes of 40 to 140 epochs, the 39 below erred by 3.5 sigmas rms (up to 9.8), the others
by 1.4 (up to 4.7)."""
DISTINCT_MOMENTS = 3.0
"""Sigmas by which two moments must differ for their axes to be determined."""
FEWEST_POINTS = 3
"""Features that fix an attitude."""


def failure(finite: bool, used: int, refused: int, square: float, k: np.ndarray) -> str:
    """Why a run is not to be believed; empty when it may be.

    Args:
        used, refused: how many measurements; square: mean squared innovation; k: the ratios at the end.
    """
    share = refused / max(refused + used, 1)
    if not finite:
        return "the filter's state is not finite"
    if share > MOST_REFUSED:
        return f"{share:.0%} of the measurements were refused"
    if square > LARGEST_SQUARE:
        return f"the innovations are {np.sqrt(square):.1f} times what the stated noise allows"
    if np.abs(k).max() > FARTHEST:
        return "the ratios ran away"
    return ""


def late_square(squares: np.ndarray, numbers: np.ndarray) -> float:
    """Mean squared innovation over the second half of a run: sums (n,) of squares and how many numbers they hold."""
    half = slice(len(squares) // 2, None)
    return float(squares[half].sum() / max(numbers[half].sum(), 1))


def unlearnt(sigma: np.ndarray, before: float) -> str:
    """Why k is known no better, sigma (2,), than at the start; empty when it is."""
    if sigma.max() > SHARP and sigma.max() > LEARNT * before:
        return f"the motion says nothing about the ratios: 1-sigma {sigma[0]:.2g}, {sigma[1]:.2g}, as at the start"
    return ""


def overconfident(sigma: np.ndarray, shown: np.ndarray, before: float) -> str:
    """Why k cannot be known as well as a filter claims, sigma (2,), when its measurements show it to `shown` (2,) and the start
    knew it to `before`; empty when it can."""
    bound = 1.0 / np.sqrt(shown**-2.0 + before**-2.0)
    if (sigma < LEAST_OF_BOUND * bound).any():
        return (
            f"the motion hardly shows the ratios: the filter claims 1-sigma {sigma[0]:.2g}, {sigma[1]:.2g}, which no filter "
            f"could know better than to {bound[0]:.2g}, {bound[1]:.2g}"
        )
    return ""


def symmetric(near: np.ndarray) -> str:
    """What is said when neighbouring moments (2,) are equal within what the motion shows; empty when none are."""
    if not near.any():
        return ""
    pair = "I1 and I2" if near[0] else "I2 and I3"
    return f"the body is symmetric within what the motion shows ({pair} are equal): its axes are not determined"


def track_weight(count: np.ndarray, size: float, pixel: float, distance: np.ndarray) -> np.ndarray:
    """(n,) one over the variance of the attitude that features fix [rad^-2], 0 where too few are seen.

    Args:
        count: (n,) sights; size: spread of the features [m]; pixel: 1-sigma [rad]; distance: (n,) [m].
    """
    return np.where(count >= FEWEST_POINTS, count * (size / (pixel * distance)) ** 2, 0.0)


def attitude_weight(
    problem: Problem, times: np.ndarray, estimate: Estimate, features: np.ndarray, updated: np.ndarray
) -> np.ndarray:
    """(n,) one over the variance of the attitude that each epoch's measurements fix [rad^-2], 0 where there are none.

    Args:
        times: (n,) [s], of the found history; features: (m, 3) those filtered [m], none where tracks were not;
        updated: (n,) whether anything was measured, for what neither tracks nor attitudes show.
    """
    assert estimate.sigma_attitude is not None
    at = np.clip(np.searchsorted(problem.times, times - 1e-9), 0, len(problem.times) - 1)
    if len(features) and estimate.position is not None:
        # a turn moves a point by its distance from the axis, two thirds of the square, and pixels show two axes of three
        size = float(np.sqrt(np.mean(np.sum((features - features.mean(axis=0)) ** 2, axis=1)) * 4 / 9))
        pixel = problem.alike * float(np.mean(problem.sigma_px)) / abs(float(problem.cameras[0].intrinsics[0]))
        count = np.minimum(problem.seen[at].sum(axis=(1, 2)), len(features) * len(problem.cameras))
        return track_weight(count, size, pixel, np.linalg.norm(estimate.position, axis=1))
    if problem.has_attitude:
        sigma = problem.sigma_attitude[at]
        good = np.isfinite(sigma) & (sigma > 0) & np.isfinite(problem.attitude[at, 0])
        return np.where(good, 1.0 / np.where(good, sigma, 1.0) ** 2, 0.0)
    variance = np.mean(estimate.sigma_attitude**2, axis=1)
    return np.where(updated, 1.0 / np.maximum(variance, 1e-16), 0.0)


def hidden(estimate: Estimate, weight: np.ndarray, before: float) -> str:
    """Why ratios or axes cannot be told from this motion; empty when they can.

    Args:
        weight: (n,) of `attitude_weight`; before: 1-sigma of k at the start.
    """
    assert (
        estimate.q is not None
        and estimate.w is not None
        and estimate.inertia is not None
        and estimate.sigma_k is not None
    )
    k, since = np.array([estimate.k1, estimate.k2], float), estimate.times[-1] - estimate.times[::-1]
    before = max(before, 1e-12)
    # from the end, where a filter's estimate is best: free motion runs backwards with the rates reversed
    shown, dark = shown_by(since, weight[::-1], estimate.q[-1], -estimate.w[-1], estimate.inertia)
    return (
        unlearnt(estimate.sigma_k, before)
        or dark
        or overconfident(estimate.sigma_k, shown, before)
        or symmetric(np.abs(k) < DISTINCT_MOMENTS * estimate.sigma_k)
    )


def concluded(estimate: Estimate, failed: str, hidden: str) -> Estimate:
    """The estimate of a run that failed for one reason, or whose motion hides the ratios for another; '' for neither."""
    estimate = replace(estimate, converged=not failed, observable=not hidden, reason=failed or hidden)
    return without_ratios(estimate) if hidden else estimate
