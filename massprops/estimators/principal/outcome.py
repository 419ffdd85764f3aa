"""From a run of the filter in principal axes to the estimate that every method gives."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply, rotate, rotation_matrix
from massprops.estimators import verdict
from massprops.estimators.body_frame import mean_turn
from massprops.estimators.momentum import ratio_covariance
from massprops.estimators.principal.follow import Followed
from massprops.estimators.principal.run import (
    Filtered,
    axes_against_features,
)
from massprops.estimators.problem import Problem
from massprops.estimators.result import Estimate

SURE = 5.0
"""Sigmas by which two moments must differ to have axes of their own."""


def estimate_of(name: str, problem: Problem, start: Any, followed: Followed) -> Estimate:
    """The estimate in the body axes of attitude0, or in the unique principal frame."""
    first, points, run = followed.first, followed.points, followed.run
    back = conjugate(followed.camera)
    own, turn, spread = _body(problem, followed)
    axes = rotation_matrix(turn)
    k = run.k[-1]
    moments = np.array([1.0, np.exp(k[1]), np.exp(k[0] + k[1])])
    inertia, w = axes @ np.diag(moments) @ axes.T / moments.sum(), run.w @ axes.T
    found = Estimate(
        name=name,
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
