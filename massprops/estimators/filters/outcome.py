"""From a run of the filter to the estimate that every method gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.inertia import cholesky_inertia, cholesky_ratio_derivatives, principal_axes, ratios_of_moments
from massprops.dynamics.quaternion import conjugate, mean_quaternion, multiply, rotation_matrix
from massprops.estimators.filters import verdict
from massprops.estimators.filters.features import Passage
from massprops.estimators.filters.setup import Setup
from massprops.estimators.filters.state import Run
from massprops.estimators.result import Estimate
from massprops.model.problem import Problem


def estimate_of(
    name: str, problem: Problem, setup: Setup, passage: Passage, warnings: tuple[str, ...] = ()
) -> Estimate:
    """The estimate, in the body axes of attitude0 or in the filter's own."""
    run, last, times = passage.run, passage.run.last, problem.times[setup.first :]
    shape = _shape_of(run)
    body_frame, turn, axes_covariance = _body(problem, setup, passage, times, shape)
    body = rotation_matrix(turn)  # the filter's axes as columns, in body axes
    places, sigma, moving = last.places(), run.sigma, setup.state.moving
    inertia_block = run.block[:, places["k"], places["k"]]
    k_covariance = shape.by_k @ inertia_block @ np.swapaxes(shape.by_k, 1, 2)
    columns = body @ shape.axes
    known = np.isfinite(passage.points[:, 0])
    estimate = Estimate(
        name=name,
        converged=False,
        observable=False,
        k1=float(shape.k[-1, 0]),
        k2=float(shape.k[-1, 1]),
        k_covariance=k_covariance[-1],
        inertia=columns @ np.diag(shape.moments) @ columns.T / shape.moments.sum(),
        principal_axes=columns,
        axes_covariance=body @ axes_covariance @ body.T,
        times=times,
        q=multiply(run.q, conjugate(turn)),
        w=run.w @ body.T,
        position=run.position if moving else None,
        velocity=run.velocity if moving else None,
        sigma_attitude=sigma[:, places["attitude"]],
        sigma_w=sigma[:, places["w"]],
        sigma_position=sigma[:, places["position"]] if moving else None,
        sigma_velocity=sigma[:, places["velocity"]] if moving else None,
        k_history=shape.k,
        k_sigma_history=np.sqrt(np.maximum(np.einsum("nii->ni", k_covariance), 0.0)),
        features=passage.points[known] @ body.T if moving else None,
        feature_ids=problem.features[known] if moving else None,
        body_frame=body_frame,
        innovation=float(run.nis.sum() / max(run.used.sum(), 1)),
        gated=int(run.gated.sum()),
        used=int(run.used.sum()),
        cpu_us_per_step=1e6 * run.cpu_s / max(len(times), 1),
        warnings=warnings,
    )
    finite = all(np.isfinite(x).all() for x in (run.w, run.q, run.k, last.P))
    failed = verdict.failure(finite, estimate.used, estimate.gated, verdict.late_square(run.nis, run.used), shape.k[-1])
    if failed:
        return verdict.concluded(estimate, failed, "")
    weight = verdict.attitude_weight(problem, times, estimate, passage.points[known], run.used > 0)
    return verdict.concluded(estimate, "", verdict.hidden(estimate, weight, float(setup.k_sigma.max())))


@dataclass(frozen=True)
class _Shape:
    """The inertia at the end, moments ascending (3,) and axes (3, 3) in the filter's; k1, k2 at each epoch (n, 2) and their
    derivatives by the filter's numbers (n, 2, p); that of a turn of the axes about the filter's, at the end (3, p)."""

    moments: np.ndarray
    axes: np.ndarray
    k: np.ndarray
    by_k: np.ndarray
    by_turn: np.ndarray


def _shape_of(run: Run) -> _Shape:
    if run.k.shape[1] > 2:
        moments, axes = principal_axes(cholesky_inertia(run.k))
        by_k, by_turn = cholesky_ratio_derivatives(run.k)
        return _Shape(moments[-1], axes[-1], ratios_of_moments(moments), by_k, axes[-1] @ by_turn[-1])
    moments, order, to_sorted = sorted_moments(run.k[-1])
    axes = np.eye(3)[:, order]
    axes = axes * np.array([1.0, 1.0, np.linalg.det(axes)])
    by_k = np.broadcast_to(to_sorted, (len(run.k), 2, 2))
    return _Shape(moments, axes, run.k @ to_sorted.T, by_k, np.zeros((3, 2)))


def sorted_moments(k: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moments ascending (3,), which axis each belongs to (3,), and the matrix (2, 2) that takes k to sorted k."""
    log = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, -1.0]])  # of I1, I2, I3 by k, with I2 = 1
    order = np.argsort(log @ k, kind="stable")
    rows = log[order]
    return np.exp(rows @ k), order, np.array([rows[0] - rows[1], rows[1] - rows[2]])


def _body(
    problem: Problem, setup: Setup, passage: Passage, times: np.ndarray, shape: _Shape
) -> tuple[str, np.ndarray, np.ndarray]:
    """Name of the body frame, turn (4,) of the filter's vectors into it, covariance (3, 3) of the principal axes."""
    run, last = passage.run, passage.run.last
    general, told = len(last.k) > 2, setup.sensors[0]
    if told or not setup.points:
        # the axes that are measured
        turn = conjugate(last.axes)
        at, body = last.places()["k" if general else "axes"], rotation_matrix(turn)
        to_turn = shape.by_turn if general else body.T
        # in principal axes the state's own error of these is a turn about body axes
        return ("attitude0" if told else "own"), turn, to_turn @ last.P[at, at] @ to_turn.T
    # the axes against the attitudes: what the filter's own body axes are off by cancels
    J = np.concatenate([np.zeros((3, 3)), np.eye(3), shape.by_turn], axis=1)
    covariance = J @ run.block[-1] @ J.T
    epochs = np.searchsorted(problem.times, times - 1e-9)
    measured = problem.attitude[epochs]
    if not np.isfinite(measured[:, 0]).any():
        return "own", np.array([1.0, 0, 0, 0]), covariance
    # tracks and attitude0 come from the same images: with two cameras attitude0 only names the body axes
    variance = np.square(problem.sigma_attitude[epochs]) + np.sum(run.sigma[:, 3:6] ** 2, axis=1)
    mean, extra = mean_turn(measured, run.q, variance)
    return "attitude0", mean, covariance + extra * np.eye(3)


def mean_turn(attitude: np.ndarray, q: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, float]:
    """Weighted mean turn (4,) from a filter's axes, of attitude q, to those of `attitude`, and the variance of its mean.

    Args:
        attitude, q: (n, 4), both to cam0; variance: (n,) of their difference [rad^2].
    """
    there = np.isfinite(attitude[:, 0]) & np.isfinite(variance)
    turns = multiply(conjugate(attitude[there]), q[there])
    # the last epochs know q best, and its early errors are shared by many epochs
    weight = 1.0 / variance[there] ** 2
    spread = float(np.sum(weight**2 * variance[there]) / np.sum(weight) ** 2)
    return mean_quaternion(turns, weight), spread
