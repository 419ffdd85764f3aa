"""volpe2017: relative pose, velocity, shape and inertia ratios from one camera and a range sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, multiply, rotate, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators import verdict
from massprops.estimators.begin import longest
from massprops.estimators.body_frame import mean_turn
from massprops.estimators.chaser_path import chaser_path
from massprops.estimators.inertia_parameters import inertia as tensor_of
from massprops.estimators.momentum import ratio_covariance
from massprops.estimators.problem import Problem
from massprops.estimators.ranging.filter import (
    BASE,
    RangeData,
    RangeRun,
    RangeStart,
    inertia_covariance,
    range_filtered,
    ratio_jacobian,
    ratios_over,
)
from massprops.estimators.ranging.first_frames import BatchFit, fit_first
from massprops.estimators.result import Estimate, Prior, ratios

NAME = "range-ukf"
ORDER = 45
SENTENCE = "one camera and ranges: batch fit to the first frames, then an unscented Kalman filter (volpe2017)"
NEEDS = ("tracks", "range")
NEEDS_START = False
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
SURE = 8.0
"""Sigmas by which two moments must differ to have axes of their own; equal ones always come out apart by a few."""
PUSH = 1e-8
"""Unmodelled acceleration [m/s^2 sqrt(s)]."""


def estimate(problem: Problem, prior: Prior, start: Any) -> Estimate:
    """Ratios, axes and metric motion.

    Raises:
        NotPossible: no rotation to start from, or the features cannot be placed.
    """
    start, own = _start_of(problem, prior, start)
    if start.inertia is None or start.features is None or start.position is None:
        raise NotPossible(f"{NAME}: the tracks do not place the features")
    first = int(np.searchsorted(problem.times, start.times[0] - 1e-9))
    times = problem.times[first:]
    chosen = longest(start.features, problem.seen[first:, 0].sum(axis=0), MOST_FEATURES, 3)
    if len(chosen) < 3:
        raise NotPossible(f"{NAME}: fewer than three features could be placed")
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
    return _estimate(problem, start, own, Passage(first, chosen, camera, fit, run))


@dataclass(frozen=True)
class Passage:
    """From which epoch, the features carried, cam0 to inertial (n, 4), the batch fit to the first frames, and the run
    of the filter from its last one on."""

    first: int
    chosen: np.ndarray
    camera: np.ndarray
    fit: BatchFit
    run: RangeRun


def _rest(data: RangeData, at: int) -> RangeData:
    """The data from epoch `at` on, with nothing measured there, which the batch fit has used."""
    uv, ranges = data.uv[at:].copy(), data.ranges[at:].copy()
    uv[0], ranges[0] = np.nan, np.nan
    later = data.environment
    if later.orbit is not None:
        later = replace(later, orbit=_later(later.orbit, float(data.times[at])))
    camera = None if data.camera is None else data.camera[at:]
    return replace(data, times=data.times[at:] - data.times[at], uv=uv, ranges=ranges, environment=later, camera=camera)


def _start_of(problem: Problem, prior: Prior, start: Any) -> tuple[Any, str]:
    """The start, and the name of its body axes."""
    from massprops.estimators.start import first_guess

    if problem.has_attitude:
        if getattr(start, "features", None) is not None:
            return start, "attitude0"
        return first_guess(problem, prior), "attitude0"
    raise NotPossible("one camera without attitude0: reconstruct the footage first, which gives the attitude")


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


def _estimate(problem: Problem, start: Any, own: str, passage: Passage) -> Estimate:
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
        name=NAME,
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
        body_frame=own,
        innovation=run.innovation,
        gated=run.refused + fit.outliers,
        used=run.used + fit.rows,
    )
    if own == "attitude0":
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
