"""From a run of the filter to the estimate that every method gives."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import conjugate, multiply, rotation_matrix, skew
from massprops.estimators import verdict
from massprops.estimators.body_frame import mean_turn
from massprops.estimators.problem import Problem
from massprops.estimators.result import Estimate
from massprops.estimators.unscented.features import Passage
from massprops.estimators.unscented.setup import Setup
from massprops.estimators.unscented.state import Run, State


def estimate_of(
    name: str, problem: Problem, setup: Setup, passage: Passage, times: np.ndarray, warnings: tuple[str, ...] = ()
) -> Estimate:
    """The estimate, in the body axes of attitude0 or in the filter's own principal axes.

    Args:
        times: (n,) of the run's epochs [s].
    """
    run, last = passage.run, passage.run.last
    own, turn, axes_covariance = _body(problem, setup, passage, times)
    body = rotation_matrix(turn)  # principal axes as columns, in body axes
    moments, order, to_sorted = sorted_moments(run.k[-1])
    places, sigma, moving = last.places(), run.sigma, setup.state.moving
    P_k = to_sorted @ last.P[places["k"], places["k"]] @ to_sorted.T
    columns = body[:, order]
    columns = columns * np.array([1.0, 1.0, np.sign(np.linalg.det(columns))])
    known = np.isfinite(passage.points[:, 0])
    found = Estimate(
        name=name,
        converged=False,
        observable=False,
        k1=float(np.log(moments[0] / moments[1])),
        k2=float(np.log(moments[1] / moments[2])),
        k_covariance=P_k,
        inertia=columns @ np.diag(moments) @ columns.T / moments.sum(),
        principal_axes=columns,
        axes_covariance=body @ axes_covariance @ body.T,
        times=times,
        q=multiply(run.q, conjugate(turn)),
        w=run.w @ body.T,
        position=run.position if moving else None,
        velocity=run.velocity if moving else None,
        sigma_attitude=sigma[:, 3:6],
        sigma_w=sigma[:, :3],
        sigma_position=sigma[:, places["position"]] if moving else None,
        sigma_velocity=sigma[:, places["velocity"]] if moving else None,
        k_history=run.k @ to_sorted.T,
        k_sigma_history=np.sqrt(np.einsum("ai,nij,aj->na", to_sorted, run.block[:, 6:8, 6:8], to_sorted)),
        features=passage.points[known] @ body.T if moving else None,
        feature_ids=problem.features[known] if moving else None,
        body_frame=own,
        innovation=float(run.nis.sum() / max(run.used.sum(), 1)),
        gated=int(run.gated.sum()),
        used=int(run.used.sum()),
        cpu_us_per_step=1e6 * run.cpu_s / max(len(times), 1),
        warnings=warnings,
    )
    finite = all(np.isfinite(x).all() for x in (run.w, run.q, run.k, last.P))
    failed = verdict.failure(finite, found.used, found.gated, verdict.late_square(run.nis, run.used), run.k[-1])
    return verdict.concluded(found, failed, "" if failed else _hidden(setup, run, found))


def _hidden(setup: Setup, run: Run, found: Estimate) -> str:
    """Why the ratios cannot be told from this motion; empty when they can."""
    assert found.q is not None and found.w is not None and found.inertia is not None and found.sigma_k is not None
    variance = np.mean(run.sigma[:, 3:6] ** 2, axis=1)
    weight = np.where(run.used > 0, 1.0 / np.maximum(variance, 1e-16), 0.0)
    k = np.array([found.k1, found.k2])
    return (
        verdict.unlearnt(found.sigma_k, max(float(setup.k_sigma.max()), 1e-12))
        or verdict.unseen(found.times, weight, found.q[-1], found.w[-1], found.inertia)
        or verdict.symmetric(np.abs(k) < verdict.SURE * found.sigma_k)
    )


def sorted_moments(k: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moments ascending (3,), which axis each belongs to (3,), and the matrix (2, 2) that takes k to sorted k."""
    log = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, -1.0]])  # of I1, I2, I3 by k, with I2 = 1
    order = np.argsort(log @ k, kind="stable")
    rows = log[order]
    return np.exp(rows @ k), order, np.array([rows[0] - rows[1], rows[1] - rows[2]])


def _body(problem: Problem, setup: Setup, passage: Passage, times: np.ndarray) -> tuple[str, np.ndarray, np.ndarray]:
    """Name of the body frame, turn (4,) of principal vectors into it, covariance (3, 3) of the principal axes."""
    run, last = passage.run, passage.run.last
    if not setup.points:
        at, turn = last.places()["axes"], conjugate(last.axes)
        body = rotation_matrix(turn)
        # the state's own error of these is a turn about body axes
        return ("attitude0" if setup.sensors[0] else "own"), turn, body.T @ last.P[at, at] @ body
    covariance = axes_covariance_of(last)
    epochs = np.searchsorted(problem.times, times - 1e-9)
    measured = problem.attitude[epochs]
    if not np.isfinite(measured[:, 0]).any():
        return "own", np.array([1.0, 0, 0, 0]), covariance
    # tracks and attitude0 come from the same images: with stereo points attitude0 only names the body axes
    variance = np.square(problem.sigma_attitude[epochs]) + np.sum(run.sigma[:, 3:6] ** 2, axis=1)
    mean, extra = mean_turn(measured, run.q, variance)
    return "attitude0", mean, covariance + extra * np.eye(3)


def axes_covariance_of(last: State) -> np.ndarray:
    """(3, 3) of a small turn of the principal frame against the feature points."""
    f, at = last.features, last.places()["features"]
    if len(f) < 2:
        return last.P[3:6, 3:6]
    # the turn that best explains an error of the points, weighted by how well each is known
    J = np.concatenate([skew(p) for p in f])
    weight = 1.0 / np.maximum(np.diag(last.P[at, at]), 1e-300)
    back = np.linalg.pinv((J.T * weight) @ J) @ (J.T * weight)
    return back @ last.P[at, at] @ back.T
