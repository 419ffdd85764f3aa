"""A first guess for bodies that turn far between two frames: free rotation fitted to the attitudes themselves.

Where the body turns by a radian or so from one frame to the next, polynomials in time no longer follow its attitude.
The turn between neighbours still gives the rate at their midpoint; from there Euler's equations are fitted to a window
that grows from a few frames to the whole record, so that the phase is never lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, normalise, rotation_vector
from massprops.dynamics.rigid_body import propagate
from massprops.estimators.momentum import DIRECTIONS, physical
from massprops.estimators.problem import Problem

FAST = 0.4
"""Median turn between epochs [rad] above which this fit replaces the local one."""
DOUBT = 0.15
"""1-sigma of the inertia's directions (trace 1) before the fit."""
LARGEST_TURN = 0.2
OUTLIER = 6.0
STEPS = 12


@dataclass(frozen=True)
class FreeFit:
    """q0 (4,), w0 (3,) at times[0], inertia (3, 3) trace 1, covariance (11, 11) of a small turn about body axes, rates
    and the inertia's `DIRECTIONS`, and the root mean square residual in units of sigma."""

    q0: np.ndarray
    w0: np.ndarray
    inertia: np.ndarray
    covariance: np.ndarray
    residual: float


def free_rotation(times: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> FreeFit | None:
    """Torque-free motion through attitudes; None when there are too few or nothing fits.

    Args:
        times: (n,) [s]; q: (n, 4) body to inertial; sigma: (n,) of a small turn [rad].
    """
    n = len(times)
    if n < 6:
        return None
    inertia = np.eye(3) / 3.0
    q0 = q[0]
    w0 = rotation_vector(multiply(conjugate(q[0]), q[1])) / (times[1] - times[0])
    fit = None
    count = 6
    while True:
        fit = _fitted(times[:count], q[:count], sigma[:count], q0, w0, inertia)
        if fit is None:
            return None
        q0, w0, inertia = fit.q0, fit.w0, fit.inertia
        if count == n:
            return fit
        count = min(n, int(np.ceil(1.5 * count)))


def _residual(times: np.ndarray, q: np.ndarray, q0: np.ndarray, w0: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    path, _ = propagate(q0, w0, inertia, times, largest_turn=LARGEST_TURN)
    measured = q if path.ndim == 2 else q[:, None]
    return rotation_vector(multiply(conjugate(path), measured))


def _fitted(
    times: np.ndarray, q: np.ndarray, sigma: np.ndarray, q0: np.ndarray, w0: np.ndarray, inertia: np.ndarray
) -> FreeFit | None:
    """Levenberg-Marquardt, derivatives by differences, outliers weighed down."""
    h = np.array([1e-6] * 3 + [1e-6 * max(float(np.linalg.norm(w0)), 1e-9)] * 3 + [1e-6] * 5)
    prior = np.array([0.0] * 6 + [1.0 / DOUBT**2] * 5)
    damping, best = 1e-3, np.inf
    accepted = (q0, w0, inertia)
    normal = np.eye(11)
    for _ in range(STEPS):
        a, b, I = accepted
        Q = np.concatenate([a[None], multiply(a, from_rotation_vector(np.diag(h[:3]))), np.tile(a, (8, 1))])
        W = np.tile(b, (12, 1))
        W[4:7] += np.diag(h[3:6])
        inertias = np.tile(I, (12, 1, 1))
        inertias[7:] += h[6:, None, None] * DIRECTIONS
        e = _residual(times, q, Q, W, inertias)
        J = ((e[:, 1:] - e[:, :1]) / h[:, None]).transpose(0, 2, 1) / sigma[:, None, None]
        r = e[:, 0] / sigma[:, None]
        length = np.linalg.norm(r, axis=1)
        weight = 1.0 / np.maximum(1.0, length / max(OUTLIER, 2.0 * float(np.median(length))))
        away = np.einsum("aij,ij->a", DIRECTIONS, I - np.eye(3) / 3.0)
        normal = np.einsum("n,nia,nib->ab", weight, J, J) + np.diag(prior)
        side = -np.einsum("n,nia,ni->a", weight, J, r) - prior * np.concatenate([np.zeros(6), away])
        cost = _cost(r, weight, away)
        best = cost
        for _ in range(8):
            x = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), side)
            trial_i = physical(I + np.einsum("a,aij->ij", x[6:], DIRECTIONS))
            trial = (normalise(multiply(a, from_rotation_vector(x[:3]))), b + x[3:6], trial_i)
            r_new = _residual(times, q, *trial) / sigma[:, None]
            away_new = np.einsum("aij,ij->a", DIRECTIONS, trial_i - np.eye(3) / 3.0)
            new = _cost(r_new, weight, away_new)
            if new < cost:
                accepted, best, damping = trial, new, max(damping / 5.0, 1e-9)
                break
            damping *= 6.0
        else:
            break
        if cost - best < 1e-6 * cost:
            break
    if not np.isfinite(best):
        return None
    r = _residual(times, q, *accepted) / sigma[:, None]
    scale = float(np.median(np.sum(r**2, axis=1))) / 2.366  # the median of chi-square with three degrees
    covariance = np.linalg.pinv(normal, hermitian=True) * max(scale, 1.0)
    return FreeFit(*accepted, covariance, float(np.sqrt(scale)))


def _cost(r: np.ndarray, weight: np.ndarray, away: np.ndarray) -> float:
    return float(np.sum(weight[:, None] * r**2) + np.sum(away**2) / DOUBT**2)


def with_free_rotation(problem: Problem, start: Any) -> Any:
    """The start with attitude, rates and inertia of a free fit where the body turns too far between epochs.

    A chaser that turns, or a fit that does not reach the noise, leaves the start as it is.
    """
    if start.index is None or len(start.times) < 6 or problem.environment.chaser_attitude == "lvlh":
        return start
    raw = _attitudes(problem, start)
    if raw is None:
        return start
    rows, q, sigma = raw
    turn = np.median(np.linalg.norm(rotation_vector(multiply(conjugate(q[:-1]), q[1:])), axis=1))
    if turn < FAST:
        return start
    times = problem.times[rows]
    fit = free_rotation(times, q, sigma)
    if fit is None or fit.residual > 5.0:
        return start
    path, rates = propagate(fit.q0, fit.w0, fit.inertia, times)
    covariance = np.tile(fit.covariance[:6, :6], (len(times), 1, 1))
    momentum = None if start.momentum is None else replace(
        start.momentum, inertia=fit.inertia, covariance=fit.covariance[6:, 6:]
    )  # fmt: skip
    position = start.position
    if position is not None:
        position = np.stack([np.interp(times, start.times, position[:, i]) for i in range(3)], axis=-1)
    return replace(
        start,
        times=times,
        q=path,
        w=rates,
        position=position,
        inertia=fit.inertia,
        covariance=covariance,
        momentum=momentum,
        index=rows,
    )


def _attitudes(problem: Problem, start: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Epochs (k,), attitudes (k, 4) as measured at each alone, and their 1-sigma (k,), within the start's span."""
    early = np.flatnonzero(problem.times <= start.times[-1] + 1e-9)
    if start.body_frame == "attitude0":
        rows = early[np.isfinite(problem.attitude[early, 0])]
        return rows, problem.attitude[rows], np.maximum(problem.sigma_attitude[rows], 1e-9)
    if not problem.stereo or start.features is None:
        return None
    from massprops.estimators import bodymodel
    from massprops.sensing.stereo import triangulate

    points, spread = triangulate(problem.cameras, np.moveaxis(problem.uv[early], 1, 2), problem.sigma_px)
    motion = bodymodel.body_motion(points, spread)
    if motion is None:
        return None
    rows = early[motion.used]
    sigma = np.sqrt(np.einsum("nii->n", motion.covariance[motion.used][:, :3, :3]) / 3.0)
    return rows, motion.q[motion.used], np.maximum(sigma, 1e-9)
