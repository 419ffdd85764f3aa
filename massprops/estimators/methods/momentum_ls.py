"""feng2018: the inertia ratios from conservation of angular momentum, all epochs at once."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.inertia import DIRECTIONS, ratios
from massprops.dynamics.quaternion import multiply, rotation_matrix
from massprops.estimators.momentum import Momentum, momentum_inertia
from massprops.estimators.observability import judge
from massprops.estimators.result import Estimate, Halves, Prior
from massprops.estimators.start import Start, first_guess, within
from massprops.model.problem import Problem

NAME = "momentum-ls"
ORDER = 10
SENTENCE = (
    "feng2018: attitude and rates by least squares, inertia from conserved angular momentum with errors in the rates."
)
NEEDS = ("stereo|attitude|rates",)
WORST_SQUARE = 4.0
"""Mean squared residual in units of its stated covariance beyond which momentum is not conserved."""


def estimate(problem: Problem, prior: Prior, start: Start | None) -> Estimate:
    """Motion, and inertia up to scale; the prior is not used, so that the answer stands alone."""
    if start is None or start.index is None or start.times[-1] < _last(problem):
        start = first_guess(problem)
    begun = time.process_time()
    momentum = start.momentum
    covariance = start.covariance * (_widened(problem, start) / problem.alike**2)
    sigma = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
    # turns about camera axes are what others compare
    R = rotation_matrix(start.q)
    turned = R @ covariance[:, :3, :3] @ np.swapaxes(R, 1, 2)
    motion = Estimate(
        NAME,
        converged=False,
        observable=False,
        reason="too few epochs with rates",
        times=start.times,
        q=start.q,
        w=start.w,
        sigma_w=sigma[:, 3:],
        sigma_attitude=np.sqrt(np.maximum(np.einsum("nii->ni", turned), 0.0)),
        position=start.position,
        velocity=start.velocities,
        features=start.features,
        feature_ids=None if start.features is None else problem.features,
        body_frame=start.body_frame,
        gated=start.outliers,
        warnings=start.warnings,
    )
    if momentum is not None:
        motion = _with_inertia(motion, replace(momentum, covariance=_widened(problem, start) * momentum.covariance))
        motion = replace(motion, halves=_halves(problem, start, momentum.inertia), memory_counted=True)
    spent = start.cpu_s + time.process_time() - begun
    return replace(motion, cpu_us_per_step=spent / max(len(start.times), 1) * 1e6)


def _widened(problem: Problem, start: Start) -> float:
    """Factor on covariances: the momentum's own scatter knows nothing of errors that last longer than its windows, nor of those of
    attitudes that follow one free motion by their making, such as those of `massprops.sfm.along_motion`: it is at least as large as
    they were stated before they were found alike."""
    alike = problem.alike**2
    return max(alike, 1.0 / (alike * start.unexplained))


def _halves(problem: Problem, start: Start, inertia: np.ndarray) -> Halves | None:
    """The inertia by each half of the record, where each shows it by itself."""
    q = multiply(chaser_path(problem.environment, start.times).q, start.q)
    middle, out = len(start.times) // 2, []
    for rows in (slice(0, middle), slice(middle, None)):
        block = None if start.block is None else start.block[rows]
        covariance = start.covariance[rows] if block is None else within(start.covariance[rows], block)
        half = momentum_inertia(q[rows], start.w[rows], covariance, block, start.window, inertia)
        if half is None or not judge(half).observable:
            return None
        covered = _widened(problem, start) * max(1.0, half.square) * half.covariance
        out.append((np.einsum("aij,ij->a", DIRECTIONS, half.inertia), covered))
    return out[0], out[1]


def _with_inertia(motion: Estimate, momentum: Momentum) -> Estimate:
    judged = judge(momentum)
    converged = bool(momentum.square < WORST_SQUARE)
    reason = judged.reason
    if not converged:
        reason = (
            f"angular momentum is not conserved: residuals {np.sqrt(momentum.square):.1f} times their noise; "
            "a torque acts, or the noise is larger than stated"
        )
    motion = replace(
        motion, converged=converged, reason=reason, used=int(momentum.used.sum()), innovation=float(momentum.square)
    )
    if not judged.observable:
        return motion
    k, axes = ratios(momentum.inertia)
    return replace(
        motion, observable=True, k1=float(k[0]), k2=float(k[1]), k_covariance=judged.k_covariance, inertia=momentum.inertia,
        principal_axes=axes, axes_covariance=judged.axes_covariance,
    )  # fmt: skip


def _last(problem: Problem) -> float:
    """Time of the last epoch that measures anything this method takes."""
    measured = np.isfinite(problem.attitude).all(axis=1)
    if not measured.any() and problem.stereo:
        measured = (problem.seen[:, 0] & problem.seen[:, 1]).sum(axis=1) >= 3
    elif not measured.any():
        measured = np.isfinite(problem.rates).all(axis=1)
    return float(problem.times[measured][-1]) if measured.any() else 0.0
