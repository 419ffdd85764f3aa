"""From a run of the EKF or the iterated EKF to the estimate that every method gives."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.inertia import cholesky_ratio_derivatives, principal_axes, ratios_of_moments
from massprops.dynamics.quaternion import from_rotation_matrix, multiply, rotation_matrix, skew
from massprops.estimators.extended.error_state import Layout
from massprops.estimators.extended.run import Passage
from massprops.estimators.extended.setup import Setup
from massprops.estimators.filters import verdict
from massprops.estimators.inertia_parameters import inertia
from massprops.estimators.result import Estimate, ratios
from massprops.model.problem import Problem

RUNAWAY, FARTHEST = 4.9, 8.0
"""|k| of no real body, and how many of the start's sigmas k can move and still be believed: where the motion hardly
shows it, noise that the filter takes for motion drives it away, with a small covariance."""


def estimate_of(name: str, problem: Problem, setup: Setup, passage: Passage) -> Estimate:
    """The estimate in the body axes that the start chose."""
    times, layout, P, points = problem.times[setup.first :], setup.layout, passage.P, setup.points
    q, W, r, v, parameters = (
        np.stack([getattr(s, part)[0] for s in passage.states]) for part in ("q", "W", "r", "velocity", "k")
    )
    back = np.stack([setup.surroundings.camera_frame(float(t))[0].T for t in times])
    w, by_w, by_v = _body_rates(layout, q, W, r)
    tensor = inertia(parameters)
    moments, axes = principal_axes(tensor)
    k, J = ratios_of_moments(moments), np.concatenate(cholesky_ratio_derivatives(parameters), axis=1)
    shape = J @ P[:, layout.k, layout.k] @ np.swapaxes(J, 1, 2)
    known = np.isfinite(passage.points[:, 0])
    found = Estimate(
        name=name,
        converged=False,
        observable=False,
        k1=float(k[-1, 0]),
        k2=float(k[-1, 1]),
        k_covariance=shape[-1, :2, :2],
        inertia=tensor[-1],
        principal_axes=axes[-1],
        axes_covariance=axes[-1] @ shape[-1, 2:, 2:] @ axes[-1].T,
        times=times,
        q=multiply(from_rotation_matrix(back), q),
        w=w,
        position=np.einsum("nij,nj->ni", back, r) if points else None,
        velocity=np.einsum("nij,nj->ni", back, v) if points else None,
        sigma_attitude=np.sqrt(np.einsum("nii->ni", P[:, layout.theta, layout.theta])),
        sigma_w=_spread(by_w, P),
        sigma_position=_spread(back, P[:, layout.r, layout.r]) if points else None,
        sigma_velocity=_spread(back @ by_v, P) if points else None,
        k_history=k,
        k_sigma_history=np.sqrt(np.maximum(np.einsum("nii->ni", shape), 0.0))[:, :2],
        features=passage.points[known] if points else None,
        feature_ids=problem.features[known] if points else None,
        body_frame=setup.body_frame,
        innovation=float(passage.squares.sum() / max(int(passage.numbers.sum()), 1)),
        gated=int(passage.gated.sum()),
        used=int(passage.numbers.sum()),
        cpu_us_per_step=1e6 * passage.cpu_s / max(len(times), 1),
    )
    finite = bool(np.isfinite(P).all() and np.isfinite(q).all())
    square = verdict.late_square(passage.squares, passage.numbers)
    failed = verdict.failure(finite, found.used, found.gated, square)
    return verdict.concluded(found, failed, "" if failed else _hidden(problem, setup, passage, found, q[-1]))


def _body_rates(layout: Layout, q: np.ndarray, W: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, ...]:
    """Body rates (n, 3), and the derivatives (n, 3, size) of them and of the centre's velocity by the error."""
    R = rotation_matrix(q)
    w = np.einsum("nji,nj->ni", R, W)
    by_w = np.zeros((len(q), 3, layout.size))
    by_w[:, :, layout.w] = np.swapaxes(R, 1, 2)
    by_w[:, :, layout.theta] = skew(w)
    by_v = np.zeros((len(q), 3, layout.size))
    by_v[:, :, layout.u] = np.eye(3)
    by_v[:, :, layout.w] = -skew(r)
    by_v[:, :, layout.r] = skew(W)
    return w, by_w, by_v


def _spread(J: np.ndarray, P: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.maximum(np.einsum("nai,nij,naj->na", J, P, J, optimize=True), 0.0)))


def _hidden(problem: Problem, setup: Setup, passage: Passage, found: Estimate, q: np.ndarray) -> str:
    """Why the ratios cannot be told from this motion; empty when they can. q: (4,) at the end, to inertial axes."""
    assert found.k_history is not None and found.k_sigma_history is not None
    assert found.w is not None and found.inertia is not None
    k, sigma = found.k_history[-1], found.k_sigma_history[-1]
    before, _ = ratios(inertia(setup.state.k[0]))
    if np.abs(k).max() > RUNAWAY or np.abs(k - before).max() > FARTHEST * setup.k_sigma:
        return "the motion hardly shows the ratios: they ran away from where they began"
    return (
        verdict.unlearnt(sigma, setup.k_sigma)
        or verdict.unseen(found.times, _weight(problem, setup, passage), q, found.w[-1], found.inertia)
        or verdict.symmetric(np.abs(k) < verdict.SURE * sigma)
    )


def _weight(problem: Problem, setup: Setup, passage: Passage) -> np.ndarray:
    """(n,) one over the variance of the attitude that each epoch's measurements fix [rad^-2], 0 where there are none."""
    if setup.points:
        distance = np.array([np.linalg.norm(s.r[0]) for s in passage.states])
        pixel = float(np.mean(problem.sigma_px)) / float(problem.cameras[0].intrinsics[0])
        return verdict.track_weight(passage.numbers / 2.0, setup.size, pixel, distance)
    if setup.share[1] > 0:
        sigma = problem.sigma_attitude[setup.first :]
        good = np.isfinite(sigma) & (sigma > 0)
        return np.where(good, 1.0 / np.where(good, sigma, 1.0) ** 2, 0.0)
    variance = np.mean(np.einsum("nii->ni", passage.P[:, setup.layout.theta, setup.layout.theta]), axis=1)
    return np.where(passage.numbers > 0, 1.0 / np.maximum(variance, 1e-16), 0.0)
