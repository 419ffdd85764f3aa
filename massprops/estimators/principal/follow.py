"""hu2024: a sequence followed by the filter, from the least-squares start on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import multiply, rotation_matrix
from massprops.estimators.begin import WIDER, longest, ratio_sigmas
from massprops.estimators.chaser_path import ChaserPath, chaser_path
from massprops.estimators.geometry.stereo_path import linear_path
from massprops.estimators.principal.frame import ratios_of_moments, unique_frame
from massprops.estimators.principal.run import (
    Filtered,
    FilterStart,
    filtered,
    in_other_frame,
    start_in_frame,
)
from massprops.estimators.problem import Problem
from massprops.estimators.result import Prior
from massprops.sensing.stereo import triangulate

MOST_FEATURES = 24
"""Feature points that the filter carries: the longest seen."""


@dataclass(frozen=True)
class Followed:
    """A run of the filter over a sequence: from which epoch, its first principal axes (3, 3) in the start's body
    axes, the features carried, whether stereo points were (or attitude0), cam0 to inertial (n, 4), and the run."""

    first: int
    frame: np.ndarray
    chosen: np.ndarray
    points: bool
    camera: np.ndarray
    run: Filtered


def followed(
    problem: Problem, prior: Prior, start: Any, noise: float, push: float, turn: np.ndarray | None = None
) -> Followed:
    """The filter in the unique principal frame of the start's inertia.

    Args:
        noise: unmodelled angular acceleration [rad/s^2 sqrt(s)]; push: unmodelled acceleration [m/s^2 sqrt(s)].
        turn: (3, 3) to the unique frame from another of the 24, which is followed in its place from the same start.
    """
    first = int(np.searchsorted(problem.times, start.times[0] - 1e-9))
    moments, frame = unique_frame(start.inertia)
    path = chaser_path(problem.environment, problem.times[first:])
    points = problem.stereo and start.features is not None and start.position is not None
    chosen = np.zeros(0, int)
    if points:
        chosen = longest(start.features, problem.seen.sum(axis=(0, 1)), MOST_FEATURES)
    begin = _begin(problem, prior, start, frame, moments, chosen, points, path)
    if turn is not None:
        begin, frame = in_other_frame(begin, turn), frame @ turn
    return Followed(first, frame, chosen, points, path.q, run_over(problem, begin, first, chosen, path, noise, push))


def run_over(
    problem: Problem, begin: FilterStart, first: int, chosen: np.ndarray, path: ChaserPath, noise: float, push: float
) -> Filtered:
    """The filter from any start; the features `chosen`, or attitude0 where there are none."""
    points = bool(len(chosen))
    times = problem.times[first:]
    # tracks and attitude0 come from the same images: with stereo points attitude0 only names the body axes
    return filtered(
        begin,
        times,
        problem.cameras if points else (),
        problem.uv[first:, :, chosen] if points else np.zeros((len(times), 0, 0, 2)),
        problem.sigma_px if points else np.zeros(0),
        np.full((len(times), 4), np.nan) if points else problem.attitude[first:],
        problem.sigma_attitude[first:],
        path,
        noise**2,
        push**2,
    )


def _begin(
    problem: Problem,
    prior: Prior,
    start: Any,
    frame: np.ndarray,
    moments: np.ndarray,
    chosen: np.ndarray,
    points: bool,
    path: ChaserPath,
) -> FilterStart:
    """State and spread at the start's first time."""
    f = start.features[chosen] if points else np.zeros((0, 3))
    camera = path.q[0]
    spread = WIDER * np.sqrt(np.maximum(np.diagonal(start.covariance[0]), 0.0))
    k, axes = ratio_sigmas(start, start.inertia, frame)
    if prior.inertia is not None and start.momentum is None:
        k = k if prior.k_sigma is None else prior.k_sigma
        axes = axes if prior.axes_sigma is None else prior.axes_sigma
    q = multiply(camera, start.q[0])
    sigma = {
        "attitude": np.maximum(spread[:3].max(), 1e-5),
        "rate": np.maximum(spread[3:].max(), 1e-9),
        "k": k,
        "axes": axes,
        "position": 0.0,
        "velocity": 0.0,
        "features": 0.0,
    }
    r, v, place = np.zeros(3), np.zeros(3), None
    if points:
        r, v, f, place = _placed(problem, start, chosen, path)
        place = WIDER**2 * place
    return start_in_frame(
        frame, q, start.w[0], ratios_of_moments(moments), r, v, f, sigma, body_fixed=not points, place=place
    )


def _placed(
    problem: Problem, start: Any, chosen: np.ndarray, path: ChaserPath
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position and velocity (inertial) at the start's first time, features (m, 3) in its body axes, and covariance."""
    rows = np.searchsorted(problem.times, start.times - 1e-9)
    points, covariance = triangulate(
        problem.cameras, np.moveaxis(problem.uv[rows][:, :, chosen], 1, 2), problem.sigma_px
    )
    there = rows - rows[0]
    C = rotation_matrix(path.q[there])[:, None]
    f = start.features[chosen]
    size = 3.0 * float(np.sqrt(np.mean(np.sum(f * f, axis=1))))
    part = ChaserPath(path.q[there], path.place[there], path.mu)
    x, spread = linear_path(
        start.times,
        multiply(path.q[there], start.q),
        (C @ points[..., None])[..., 0],
        C @ covariance @ np.swapaxes(C, -1, -2),
        part,
        size,
    )
    return x[:3], x[3:6], x[6:].reshape(-1, 3), spread
