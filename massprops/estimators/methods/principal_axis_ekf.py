"""hu2024: least-squares inertia, the unique principal frame, and an error-state EKF in that frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply, rotate, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators import verdict
from massprops.estimators.begin import WIDER, longest, ratio_sigmas, restlessness
from massprops.estimators.body_frame import mean_turn
from massprops.estimators.chaser_path import ChaserPath, chaser_path
from massprops.estimators.geometry.stereo_path import linear_path
from massprops.estimators.momentum import ratio_covariance
from massprops.estimators.principal.frame import ratios_of_moments, unique_frame
from massprops.estimators.principal.run import (
    Filtered,
    FilterStart,
    axes_against_features,
    filtered,
    in_other_frame,
    start_in_frame,
)
from massprops.estimators.problem import Problem
from massprops.estimators.result import Estimate, Prior
from massprops.sensing.stereo import triangulate

NAME = "principal-axis-ekf"
ORDER = 60
SENTENCE = "least-squares inertia, one principal frame for good, then an extended Kalman filter in it (hu2024)"
NEEDS = ("stereo|attitude",)
MOST_FEATURES = 24
"""Feature points that the filter carries: the longest seen."""
SURE = 5.0
"""Sigmas by which two moments must differ to have axes of their own."""


def estimate(problem: Problem, prior: Prior, start: Any) -> Estimate:
    """Ratios, axes and motion by the filter, from the least-squares start.

    Raises:
        NotPossible: the start found no rotation or no inertia.
    """
    if start.inertia is None or start.w is None or not len(start.q):
        raise NotPossible(f"{NAME}: no rotation could be found to start from")
    points = problem.stereo and start.features is not None and start.position is not None
    if not points and not problem.has_attitude:
        raise NotPossible(f"{NAME}: neither stereo points nor attitude0 to filter")
    return _estimate(problem, start, followed(problem, prior, start, *restlessness(problem, prior, start)))


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


def _estimate(problem: Problem, start: Any, followed: Followed) -> Estimate:
    first, points, run = followed.first, followed.points, followed.run
    back = conjugate(followed.camera)
    own, turn, spread = _body(problem, followed)
    axes = rotation_matrix(turn)
    k = run.k[-1]
    moments = np.array([1.0, np.exp(k[1]), np.exp(k[0] + k[1])])
    inertia, w = axes @ np.diag(moments) @ axes.T / moments.sum(), run.w @ axes.T
    found = Estimate(
        name=NAME,
        converged=False,
        observable=False,
        k1=float(k[0]),
        k2=float(k[1]),
        k_covariance=run.P[6:8, 6:8],
        inertia=inertia,
        principal_axes=axes[:, [2, 1, 0]] * np.array([1.0, 1.0, -1.0]),
        axes_covariance=axes @ spread @ axes.T,
        times=problem.times[first:],
        q=multiply(multiply(back, run.q), conjugate(turn)),
        w=w,
        position=rotate(back, run.r) if points else None,
        velocity=rotate(back, run.v) if points else None,
        sigma_attitude=run.sigma[:, :3],
        sigma_w=run.sigma[:, 3:6],
        sigma_position=run.sigma[:, 11:14] if points else None,
        sigma_velocity=run.sigma[:, 14:17] if points else None,
        k_history=run.k,
        k_sigma_history=run.sigma[:, 6:8],
        features=run.f @ axes.T if points else None,
        feature_ids=problem.features[followed.chosen] if points else None,
        body_frame=own,
        innovation=run.innovation,
        gated=run.refused,
        used=run.passed,
    )
    finite = bool(np.isfinite(run.q).all() and np.isfinite(run.k).all() and np.isfinite(run.P).all())
    failed, hidden = verdict.failure(finite, run.passed, run.refused, k=k), ""
    if not failed:
        weight, q = _weight(problem, first, run, points), multiply(run.q[-1], conjugate(turn))
        hidden = verdict.unseen(found.times, weight, q, w[-1], inertia) or _symmetric(run, start)
    return verdict.concluded(found, failed, hidden)


def _body(problem: Problem, followed: Followed) -> tuple[str, np.ndarray, np.ndarray]:
    """Name of the body axes, the turn (4,) from the principal frame to them, covariance (3, 3) of the principal axes."""
    run, first = followed.run, followed.first
    if not followed.points:
        return "attitude0", run.axes[-1], run.P[8:11, 8:11]
    spread = axes_against_features(run.f, run.P)
    if not problem.has_attitude:
        return "own", from_rotation_matrix(followed.frame), spread
    variance = np.square(problem.sigma_attitude[first:]) + np.sum(run.sigma[:, :3] ** 2, axis=1)
    turn, extra = mean_turn(problem.attitude[first:], multiply(conjugate(followed.camera), run.q), variance)
    return "attitude0", turn, spread + extra * np.eye(3)


def _symmetric(run: Filtered, start: Any) -> str:
    """Why the principal axes are not determined, or an empty string: two moments that the data cannot tell apart."""
    near = np.abs(run.k[-1]) < SURE * run.sigma[-1, 6:8]
    if start.momentum is not None:
        moments = np.linalg.eigvalsh(start.inertia)
        near |= np.diff(moments) < 3.0 * ratio_covariance(start.inertia, start.momentum.covariance)[2]
    return verdict.symmetric(near)


def _weight(problem: Problem, first: int, run: Filtered, points: bool) -> np.ndarray:
    """One over the variance of the attitude that each epoch's measurements fix [rad^-2], 0 where there are none."""
    if not points:
        sigma = problem.sigma_attitude[first:]
        return np.where(np.isfinite(sigma), 1.0 / np.square(np.where(np.isfinite(sigma), sigma, 1.0)), 0.0)
    spread = run.f - run.f.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum(spread * spread, axis=1)) * 2 / 3))
    pixel = float(np.mean(problem.sigma_px)) / float(problem.cameras[0].intrinsics[0])
    return verdict.track_weight(problem.seen[first:].sum(axis=(1, 2)), size, pixel, np.linalg.norm(run.r, axis=1))
