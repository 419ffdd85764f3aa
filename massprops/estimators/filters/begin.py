"""What the filters begin with alike: from which part of the data, with which features, how wide, with what process noise."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.inertia import cholesky_ratio_derivatives
from massprops.errors import NotPossible
from massprops.estimators.result import Prior
from massprops.estimators.start import Start
from massprops.model.problem import Problem

WIDER = 3.0
"""A filter starts this many times wider than the first guess claims, for it reads the same data again."""
WIDEST_K = 0.3
"""1-sigma of k1, k2 and of the axes when nothing is known of them."""
ANGULAR_NOISE = 1e-5
"""Unmodelled angular acceleration over the square of the rate [per sqrt(s)], where no process noise is given."""
ORBIT_NOISE, DRIFT_NOISE = 1e-7, 1e-6
"""Unmodelled acceleration [m/s^2 per sqrt(s)] with the orbit known and without."""
FIRST_TURNS, FIRST_EPOCHS = 2.0, 40
"""The first guess is made from the data of so many turns and epochs."""


def early_start(problem: Problem, given: Start) -> Start:
    """The first guess from the first part of the data only; the given one where that part does not show enough."""
    from massprops.estimators.start import first_guess

    if given.early is not None:
        return given.early
    begin = float(given.times[0])
    rows = min(FIRST_EPOCHS, len(given.times)) - 1
    until = max(begin + FIRST_TURNS * 2 * np.pi / max(speed_of(given), 1e-9), float(given.times[rows]))
    if until >= given.times[-1]:
        return given
    try:
        early = first_guess(problem, until_s=until)
    except NotPossible:
        return given
    usable = early.inertia is not None and np.isfinite(early.w).all() and early.body_frame == given.body_frame
    return early if usable else given


def settled_epoch(start: Start) -> int:
    """The first row of the start whose rates are about as good as most; the ends of a record are worse."""
    spread = np.einsum("nii->n", start.covariance[:, 3:, 3:])
    return int(np.argmax(spread <= 1.5 * np.nanmedian(spread)))


def speed_of(start: Start) -> float:
    """The start's usual angular speed [rad/s]."""
    return float(np.nanmedian(np.linalg.norm(start.w, axis=1)))


def noise_densities(problem: Problem, prior: Prior, start: Start) -> tuple[float, float]:
    """Unmodelled angular acceleration [rad/s^2 per sqrt(s)] and acceleration [m/s^2 per sqrt(s)]."""
    turn = prior.process_noise if prior.process_noise is not None else ANGULAR_NOISE * speed_of(start) ** 2
    return turn, ORBIT_NOISE if problem.environment.orbit is not None else DRIFT_NOISE


def inertia_covariance(numbers: np.ndarray, k_sigma: np.ndarray, axes_sigma: np.ndarray) -> np.ndarray:
    """(5, 5) covariance of the numbers (5,) of `inertia.cholesky_inertia` from sigmas of k1, k2 (2,) and of turns of the
    principal axes about themselves (3,) [rad]."""
    back = np.linalg.inv(np.concatenate(cholesky_ratio_derivatives(numbers)))
    spread = np.concatenate([np.broadcast_to(k_sigma, 2), np.broadcast_to(axes_sigma, 3)]) ** 2
    return (back * spread) @ back.T


def longest(placed: np.ndarray, count: np.ndarray, most: int, least: int = 1) -> np.ndarray:
    """Numbers of the features to carry: those placed, (m, 3) and NaN where not, the longest seen first.

    Args:
        count: (m,) sights of each; least: of one that is worth it.
    """
    known = np.isfinite(placed[:, 0]) & (count >= least)
    order = np.lexsort((np.arange(len(count)), -count))
    return np.sort(order[known[order]][:most])
