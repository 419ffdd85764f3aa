"""From a run of the camera-and-range filter to the estimate that every method gives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, multiply, rotate, rotation_matrix
from massprops.estimators import verdict
from massprops.estimators.body_frame import mean_turn
from massprops.estimators.inertia_parameters import inertia as tensor_of
from massprops.estimators.momentum import ratio_covariance
from massprops.estimators.problem import Problem
from massprops.estimators.ranging.filter import (
    BASE,
    RangeRun,
    ratio_jacobian,
    ratios_over,
)
from massprops.estimators.ranging.first_frames import BatchFit
from massprops.estimators.ranging.passage import MOST_FEATURES, Passage
from massprops.estimators.result import Estimate, ratios

SURE = 8.0
"""Sigmas by which two moments must differ to have axes of their own; equal ones always come out apart by a few."""


def estimate_of(name: str, problem: Problem, start: Any, passage: Passage) -> Estimate:
    """The estimate in the body axes of attitude0."""
    fit, run, back = passage.fit, passage.run, conjugate(passage.camera)
    times = problem.times[passage.first :]
    at = len(fit.y) - 1
    y = np.concatenate([fit.y[:at], np.concatenate([run.q, run.w, run.r, run.v], axis=1)])
    block = np.concatenate([fit.block[:at], run.block])
    k_run, k_covariance = ratios_over(np.concatenate([np.repeat(run.s[:1], at, axis=0), run.s]), block)
    sigma = np.sqrt(np.maximum(np.einsum("nii->ni", block), 0.0))
    tensor, q = tensor_of(run.s[-1]), multiply(back, y[:, :4])
    _, axes = ratios(tensor)
    axes = axes * (1.0 if np.linalg.det(axes) > 0 else -1.0)
    found = Estimate(
        name=name,
        converged=False,
        observable=False,
        k1=float(k_run[-1, 0]),
        k2=float(k_run[-1, 1]),
        k_covariance=k_covariance[-1],
        inertia=tensor,
        principal_axes=axes,
        axes_covariance=_axes_covariance(run, axes),
        times=times,
        q=q,
        w=y[:, 4:7],
        position=rotate(back, y[:, 7:10]),
        velocity=rotate(back, y[:, 10:13]),
        sigma_attitude=sigma[:, :3],
        sigma_w=sigma[:, 3:6],
        sigma_position=sigma[:, 11:14],
        sigma_velocity=sigma[:, 14:17],
        k_history=k_run,
        k_sigma_history=np.sqrt(np.maximum(np.einsum("nii->ni", k_covariance), 0.0)),
        features=run.f,
        feature_ids=problem.features[passage.chosen],
        body_frame="attitude0",
        innovation=run.innovation,
        gated=run.refused + fit.outliers,
        used=run.used + fit.rows,
    )
    variance = np.square(problem.sigma_attitude[passage.first :]) + np.einsum("nii->n", block[:, :3, :3])
    found = _in_body_axes(found, *mean_turn(problem.attitude[passage.first :], q, variance))
    finite = bool(np.isfinite(y).all() and np.isfinite(run.P).all())
    failed = verdict.failure(finite, run.used, run.refused, run.innovation) or _unfit(fit)
    hidden = "" if failed else _hidden(problem, start, passage, found, np.linalg.norm(y[:, 7:10], axis=1))
    return verdict.concluded(found, failed, hidden)


def _axes_covariance(run: RangeRun, axes: np.ndarray) -> np.ndarray:
    """(3, 3) of the principal axes against the attitudes: what the filter's own body axes are off by cancels."""
    J = np.zeros((3, BASE))
    J[:, :3] = np.eye(3)
    J[:, 6:11] = axes @ ratio_jacobian(run.s[-1])[1]
    covariance: np.ndarray = J @ run.block[-1] @ J.T
    return covariance


def _in_body_axes(found: Estimate, turn: np.ndarray, extra: float) -> Estimate:
    """The estimate in body axes to which `turn` (4,) leads, known to a variance of `extra` [rad^2]."""
    assert found.q is not None and found.w is not None and found.inertia is not None
    assert found.principal_axes is not None and found.axes_covariance is not None
    R = rotation_matrix(turn)
    return replace(
        found,
        q=multiply(found.q, conjugate(turn)),
        w=found.w @ R.T,
        features=None if found.features is None else found.features @ R.T,
        principal_axes=R @ found.principal_axes,
        inertia=R @ found.inertia @ R.T,
        axes_covariance=R @ found.axes_covariance @ R.T + extra * np.eye(3),
    )


def _unfit(fit: BatchFit) -> str:
    """Why the fit to the first frames is not to be believed; empty when it may be."""
    if not fit.converged:
        return "the fit to the first frames found no rest: they do not fix the motion and the inertia together"
    if fit.square > verdict.LARGEST_SQUARE:
        return f"the fit to the first frames leaves residuals of {np.sqrt(fit.square):.1f} sigma"
    return ""


def _hidden(problem: Problem, start: Any, passage: Passage, found: Estimate, distance: np.ndarray) -> str:
    """Why the ratios or the axes cannot be told; empty when they can. distance: (n,) [m]."""
    assert found.q is not None and found.w is not None and found.inertia is not None and found.sigma_k is not None
    f = passage.fit.first.f - passage.fit.first.f.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum(f * f, axis=1)) * 2 / 3))
    pixel = float(problem.sigma_px[0]) / float(problem.cameras[0].intrinsics[0])
    count = np.minimum(problem.seen[passage.first :, 0].sum(axis=1), MOST_FEATURES)
    weight = verdict.track_weight(count, size, pixel, distance)
    near = np.abs(np.array([found.k1, found.k2], float)) < SURE * found.sigma_k
    if start.momentum is not None:
        gaps = ratio_covariance(start.inertia, start.momentum.covariance)[2]
        near &= np.diff(np.linalg.eigvalsh(start.inertia)) < 3.0 * gaps
    return verdict.unseen(found.times, weight, found.q[-1], found.w[-1], found.inertia) or verdict.symmetric(near)
