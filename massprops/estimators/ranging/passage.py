"""volpe2017: a sequence followed by the batch fit to its first frames, then by the filter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import multiply, rotate
from massprops.errors import NotPossible
from massprops.estimators.begin import longest
from massprops.estimators.chaser_path import chaser_path
from massprops.estimators.momentum import ratio_covariance
from massprops.estimators.problem import Problem
from massprops.estimators.ranging.filter import (
    BASE,
    RangeData,
    RangeRun,
    RangeStart,
    inertia_covariance,
    range_filtered,
)
from massprops.estimators.ranging.first_frames import BatchFit, fit_first
from massprops.estimators.result import Prior

MOST_FEATURES = 12
"""Feature points that the filter carries, as many as the paper's."""
FIRST_TURN = 12.0
"""Rotation [rad] that the batch fit at the start covers."""
SHARE = 0.5
"""And no more than this share of the record, so that there is something left to filter."""
MOST_BATCH = 300
QUIET = 1e-6
"""Unmodelled angular acceleration over the square of the rate [per sqrt(s)], where no process noise is given."""
VAGUE = 0.3
"""1-sigma of k1 or k2 above which the start's inertia is not believed."""
PUSH = 1e-8
"""Unmodelled acceleration [m/s^2 sqrt(s)]."""


@dataclass(frozen=True)
class Passage:
    """From which epoch, the features carried, cam0 to inertial (n, 4), the batch fit to the first frames, and the run
    of the filter from its last one on."""

    first: int
    chosen: np.ndarray
    camera: np.ndarray
    fit: BatchFit
    run: RangeRun


def start_of(problem: Problem, prior: Prior, start: Any) -> Any:
    """The start, with features placed, in the body axes of attitude0.

    Raises:
        NotPossible: no attitude0.
    """
    from massprops.estimators.start import first_guess

    if not problem.has_attitude:
        raise NotPossible("one camera without attitude0: reconstruct the footage first, which gives the attitude")
    return start if getattr(start, "features", None) is not None else first_guess(problem, prior)


def passage_of(problem: Problem, prior: Prior, start: Any) -> Passage:
    """The batch fit to the first frames and the filter from its last one on.

    Raises:
        NotPossible: the features cannot be placed.
    """
    if start.inertia is None or start.features is None or start.position is None:
        raise NotPossible("the tracks do not place the features")
    first = int(np.searchsorted(problem.times, start.times[0] - 1e-9))
    times = problem.times[first:]
    chosen = longest(start.features, problem.seen[first:, 0].sum(axis=0), MOST_FEATURES, 3)
    if len(chosen) < 3:
        raise NotPossible("fewer than three features could be placed")
    camera = chaser_path(problem.environment, times).q
    shift = problem.environment
    if problem.environment.orbit is not None and times[0] > 0:
        shift = replace(problem.environment, orbit=_later(problem.environment.orbit, float(times[0])))
    data = RangeData(
        times=times - times[0],
        intrinsics=problem.cameras[0].intrinsics,
        uv=np.ascontiguousarray(problem.uv[first:, 0, chosen]),
        sigma_px=problem.alike * float(problem.sigma_px[0]),
        ranges=problem.range_m[first:].copy(),
        sigma_range=problem.sigma_range,
        environment=shift,
        camera=camera,
    )
    n = _window(times, start)
    windows = tuple(k for k in (6, 9, 14, 21, 32, 48, 72, 108, 162, 243) if k < n)
    fit = fit_first(_begin(problem, prior, start, chosen, camera), data.first(n), windows)
    speed = float(np.linalg.norm(fit.first.w))
    noise = prior.process_noise if prior.process_noise is not None else QUIET * speed**2
    run = range_filtered(fit.last, _rest(data, n - 1), noise**2, PUSH**2)
    return Passage(first, chosen, camera, fit, run)


def _rest(data: RangeData, at: int) -> RangeData:
    """The data from epoch `at` on, with nothing measured there, which the batch fit has used."""
    uv, ranges = data.uv[at:].copy(), data.ranges[at:].copy()
    uv[0], ranges[0] = np.nan, np.nan
    later = data.environment
    if later.orbit is not None:
        later = replace(later, orbit=_later(later.orbit, float(data.times[at])))
    camera = None if data.camera is None else data.camera[at:]
    return replace(data, times=data.times[at:] - data.times[at], uv=uv, ranges=ranges, environment=later, camera=camera)


def _window(times: np.ndarray, start: Any) -> int:
    """Epochs of the batch fit: enough rotation to make the rest linear, not more than a share of the record."""
    speed = max(float(np.median(np.linalg.norm(start.w, axis=1))), 1e-12)
    n = int(np.searchsorted(times, times[0] + FIRST_TURN / speed))
    return int(min(max(n, 12), MOST_BATCH, max(int(SHARE * len(times)), 6), len(times)))


def _begin(problem: Problem, prior: Prior, start: Any, chosen: np.ndarray, camera: np.ndarray) -> RangeStart:
    """A guess and how wide it is: wide enough that the batch fit is led by the measurements."""
    f = start.features[chosen]
    size = float(np.sqrt(np.mean(np.sum(f * f, axis=1))))
    speed = float(np.linalg.norm(start.w[0]))
    spread = np.sqrt(np.maximum(np.diagonal(start.covariance[0]), 0.0))
    length = max(float(start.times[-1] - start.times[0]), 1e-9)
    k, axes = np.full(2, 0.3), np.full(3, 0.5)
    if prior.inertia is not None:
        k = k if prior.k_sigma is None else np.asarray(prior.k_sigma)
        axes = axes if prior.axes_sigma is None else np.asarray(prior.axes_sigma)
    tensor = start.inertia
    if start.momentum is not None:
        sigma_k = np.sqrt(np.diag(ratio_covariance(tensor, start.momentum.covariance)[0]))
        if not (sigma_k < VAGUE).all():
            # what least squares makes of a motion that hardly shows the inertia can be a needle: begin near a ball
            V = np.linalg.eigh(tensor)[1]
            tensor = V @ np.diag([0.28, 0.33, 0.39]) @ V.T
    m = len(chosen)
    P = np.zeros((BASE + 3 * m, BASE + 3 * m))
    diagonal = np.concatenate(
        [
            # the body axes are attitude0's only as well as its first epochs say; the rest of it is not used again
            np.maximum(3 * spread[:3], 1e-5) ** 2,
            np.full(3, max(10 * spread[3:].max(), 0.2 * speed) ** 2),
            np.zeros(5),
            np.full(3, size**2),
            np.full(3, (size / length + 0.2 * speed * size) ** 2),
            np.full(3 * m, size**2),
        ]
    )
    P[np.diag_indices(len(P))] = diagonal
    P[6:11, 6:11] = inertia_covariance(tensor, k, axes)
    velocity = np.zeros(3) if start.velocity is None else start.velocity
    return RangeStart(
        multiply(camera[0], start.q[0]),
        start.w[0],
        tensor,
        rotate(camera[0], start.position[0]),
        rotate(camera[0], velocity),
        f,
        P,
    )


def _later(orbit: Any, seconds: float) -> Any:
    """The same orbit with its true anomaly some time later."""
    from massprops.dynamics.surroundings import eccentric_anomaly

    e = orbit.eccentricity
    half = np.sqrt((1 - e) / (1 + e)) * np.tan(orbit.true_anomaly_rad / 2)
    E0 = 2 * np.arctan(half)
    mean = E0 - e * np.sin(E0) + np.sqrt(orbit.mu_m3_s2 / orbit.semi_major_axis_m**3) * seconds
    E = eccentric_anomaly(float(mean), e)
    return replace(orbit, true_anomaly_rad=float(2 * np.arctan(np.sqrt((1 + e) / (1 - e)) * np.tan(E / 2))))
