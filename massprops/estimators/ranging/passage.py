"""volpe2017: a sequence followed by the batch fit to its first frames, then by the filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.inertia import DIRECTIONS, cholesky_parameters, principal_axes, ratio_derivatives
from massprops.dynamics.quaternion import conjugate, multiply, rotate
from massprops.errors import NotPossible
from massprops.estimators.filters.begin import inertia_covariance, longest
from massprops.estimators.filters.features import Passage, joined
from massprops.estimators.filters.setup import Setup
from massprops.estimators.filters.state import Noise, Run
from massprops.estimators.ranging.batch_start import BatchFit, fit_first
from massprops.estimators.ranging.inertial import BASE, RangeData, RangeStart, camera_state, range_filtered, to_camera
from massprops.estimators.result import Prior
from massprops.estimators.start import Start
from massprops.model.problem import Problem

MOST_FEATURES = 12
"""Feature points that the filter carries, as many as the paper's."""
FIRST_TURN = 12.0
"""Rotation [rad] that the batch fit at the start covers."""
SHARE = 0.5
"""And no more than this share of the record, so that there is something left to filter."""
MOST_BATCH = 300
ANGULAR_NOISE = 1e-6
"""Unmodelled angular acceleration over the square of the rate [per sqrt(s)], where no process noise is given."""
VAGUE = 0.3
"""1-sigma of k1 or k2 above which the start's inertia is not believed."""
ACCELERATION_NOISE = 1e-8
"""Unmodelled acceleration [m/s^2 sqrt(s)]."""


def start_of(problem: Problem, start: Start) -> Start:
    """The start, with features placed, in the body axes of attitude0.

    Raises:
        NotPossible: no attitude0.
    """
    from massprops.estimators.start import first_guess

    if not problem.has_attitude:
        raise NotPossible("attitude0 is missing, which 'massprops reconstruct' writes for an object that tumbles")
    return start if getattr(start, "features", None) is not None else first_guess(problem)


def passage_of(problem: Problem, prior: Prior, start: Start) -> tuple[Setup, Passage, BatchFit]:
    """The batch fit to the first frames and the filter from its last one on, as one run.

    Raises:
        NotPossible: the features cannot be placed.
    """
    if start.inertia is None or start.features is None or start.position is None:
        raise NotPossible(
            "the tracks do not show where the features lie: give longer tracks, during which the body turns"
        )
    first = int(np.searchsorted(problem.times, start.times[0] - 1e-9))
    times = problem.times[first:]
    chosen = longest(start.features, problem.seen[first:, 0].sum(axis=0), MOST_FEATURES, 3)
    if len(chosen) < 3:
        raise NotPossible("fewer than three features could be placed on the body: give longer tracks")
    data = RangeData(
        times=times,
        intrinsics=problem.cameras[0].intrinsics,
        uv=problem.uv[first:, 0, chosen],
        sigma_px=problem.alike * float(problem.sigma_px[0]),
        ranges=problem.range_m[first:],
        sigma_range=problem.sigma_range,
        environment=problem.environment,
        camera=chaser_path(problem.environment, times).q,
    )
    n = _window(times, start)
    windows = tuple(k for k in (6, 9, 14, 21, 32, 48, 72, 108, 162, 243) if k < n)
    begun, k_sigma = _begin(prior, start, chosen, data.camera)
    fit = fit_first(begun, data.part(slice(n)), windows)
    rest = data.part(slice(n - 1, None))
    # nothing is measured at the filter's first epoch: the fit has used it
    unseen = np.arange(len(rest.times)) == 0
    rest = replace(
        rest, uv=np.where(unseen[:, None, None], np.nan, rest.uv), ranges=np.where(unseen, np.nan, rest.ranges)
    )
    noise = prior.process_noise
    if noise is None:
        noise = ANGULAR_NOISE * float(np.linalg.norm(fit.first.w)) ** 2
    run = joined([_as_run(fit, data.camera[: n - 1]), range_filtered(fit.last, rest, noise**2, ACCELERATION_NOISE**2)])
    points = np.full((len(problem.features), 3), np.nan)
    points[chosen] = run.last.features
    sensors = (False, False, True)
    ready = Setup(run.last, chosen, Noise(), first, True, sensors, k_sigma, warnings=tuple(start.warnings))
    return ready, Passage(run, points, chosen), fit


def _as_run(fit: BatchFit, camera: np.ndarray) -> Run:
    """The batch fit's motion at epochs before its last, in the axes of cam0, whose attitude is `camera` (n, 4)."""
    n, y, back = len(camera), fit.y[: len(camera)], conjugate(camera)
    T = to_camera(camera)
    P = T @ fit.block[:n] @ np.swapaxes(T, 1, 2)
    nothing = np.zeros(n)
    return Run(
        w=y[:, 4:7],
        q=multiply(back, y[:, :4]),
        k=np.tile(fit.last.s, (n, 1)),
        axes=np.tile([1.0, 0, 0, 0], (n, 1)),
        position=rotate(back, y[:, 7:10]),
        velocity=rotate(back, y[:, 10:13]),
        sigma=np.sqrt(np.maximum(np.einsum("nii->ni", P), 0.0)),
        block=P[:, :11, :11],
        nis=nothing,
        used=nothing.astype(int),
        gated=nothing.astype(int),
        last=camera_state(fit.last, camera[-1]),
        cpu_s=0.0,
    )


def _window(times: np.ndarray, start: Start) -> int:
    """Epochs of the batch fit: enough rotation to make the rest linear, not more than a share of the record."""
    speed = max(float(np.median(np.linalg.norm(start.w, axis=1))), 1e-12)
    n = int(np.searchsorted(times, times[0] + FIRST_TURN / speed))
    return int(min(max(n, 12), MOST_BATCH, max(int(SHARE * len(times)), 6), len(times)))


def _begin(prior: Prior, start: Start, chosen: np.ndarray, camera: np.ndarray) -> tuple[RangeStart, np.ndarray]:
    """A guess and how wide it is, wide enough that the batch fit is led by the measurements; and the 1-sigma of k1, k2."""
    assert start.features is not None and start.inertia is not None and start.position is not None
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
        moments, V = principal_axes(tensor)
        by_k, _ = ratio_derivatives(moments, V, DIRECTIONS)
        if not (np.einsum("ka,ab,kb->k", by_k, start.momentum.covariance, by_k) < VAGUE**2).all():
            # what least squares makes of a motion that hardly shows the inertia can be a needle: begin near a ball
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
    s = cholesky_parameters(tensor)
    P[6:11, 6:11] = inertia_covariance(s, k, axes)
    q, r = multiply(camera[0], start.q[0]), rotate(camera[0], start.position[0])
    v = rotate(camera[0], np.zeros(3) if start.velocity is None else start.velocity)
    return RangeStart(q, start.w[0], s, r, v, f, P), k
