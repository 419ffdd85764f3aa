"""From a problem and a first guess to the filter's state, measurements and process noise, in the first guess's body axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from massprops.dynamics.chaser_path import chaser_path, transitions
from massprops.dynamics.inertia import DIRECTIONS, cholesky_changes, cholesky_parameters, cholesky_ratio_derivatives
from massprops.dynamics.quaternion import conjugate, multiply, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators.filters.begin import (
    WIDER,
    WIDEST_K,
    inertia_covariance,
    longest,
    noise_densities,
    settled_epoch,
)
from massprops.estimators.filters.state import Measurements, Noise, State
from massprops.estimators.free_fit import FreeFit, free_fit
from massprops.estimators.geometry.stereo_path import linear_path
from massprops.estimators.result import Prior
from massprops.estimators.start import Start
from massprops.model.problem import Problem
from massprops.sensing.pinhole import at_depth
from massprops.sensing.stereo import triangulate
from massprops.sequence.data import Environment

MOST_FEATURES = 16
"""Features carried at a time."""
TRACKS_SHARE = 0.5
"""Share of the evidence of one camera's tracks, beside that of the attitudes found from the same images. How their errors hang
together nobody states; covariance intersection with this weight never claims too much."""

UNIT = 0.01
"""1-sigma of the distance, over the body's depth, where nothing shows lengths: a filter that may still change its unit takes
what curves in that for knowledge."""


@dataclass(frozen=True)
class Setup:
    """A filter ready to run over epochs `first` and later.

    Attributes:
        state: before the measurements of epoch `first`.
        chosen: columns of the problem's features in the state.
        noise: process noise. first: epoch. points: features are measured.
        sensors: (attitude, rates, range) used. share: of the evidence, of tracks and of attitude0.
        size: spread of the features [m]. k_sigma: (2,) 1-sigma of k at the start.
    """

    state: State
    chosen: np.ndarray
    noise: Noise
    first: int
    points: bool
    sensors: tuple[bool, bool, bool]
    k_sigma: np.ndarray
    share: tuple[float, float] = (1.0, 1.0)
    size: float = 0.0
    warnings: tuple[str, ...] = ()


def setup(problem: Problem, prior: Prior, start: Start, most: int = MOST_FEATURES) -> Setup:
    """State and noise to begin with.

    Args:
        problem: the measurements.
        prior: beliefs; its inertia, where given, with its own sigmas.
        start: first guess, see `massprops.estimators.start`.
        most: features carried at a time.

    Raises:
        NotPossible: no rotation or no inertia in the first guess.
    """
    if not len(start.q):
        raise NotPossible("the first epochs show no rotation to start from: give a longer record, or more features")
    fit = free_fit(problem, start)
    row, first, q, w = _first_rotation(problem, start, fit)
    seen = _carried(problem, start, row, first, most, fit)
    numbers, turning = _turning(problem, prior, start, fit, row)
    by_k, _ = cholesky_ratio_derivatives(numbers)
    state = State(
        w=w,
        q=q,
        k=numbers,
        features=seen.features,
        P=block_diag(turning, seen.others),
        position=seen.position,
        velocity=seen.velocity,
        moving=seen.points,
    )
    told = problem.has_attitude and start.body_frame == "attitude0" and not (seen.points and problem.stereo)
    # imu0 and the tracks need not share body axes
    sensors = (told, not seen.points and problem.has_rates, seen.points and problem.has_range)
    return Setup(
        state=state,
        chosen=seen.chosen,
        noise=_noise(problem, prior, start),
        first=first,
        points=seen.points,
        sensors=sensors,
        k_sigma=np.sqrt(np.einsum("ai,ij,aj->a", by_k, turning[6:, 6:], by_k)),
        share=(TRACKS_SHARE, 1.0 - TRACKS_SHARE) if seen.points and told else (1.0, 1.0),
        size=float(np.sqrt(np.mean(np.sum(seen.features**2, axis=1)))) if seen.points else 0.0,
        warnings=tuple(start.warnings),
    )


def _first_rotation(problem: Problem, start: Start, fit: FreeFit | None) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Row of the start and epoch of the problem where the filter begins, and attitude (4,) and rates (3,) there."""
    if fit is not None:
        return int(np.argmin(np.abs(start.times - problem.times[fit.rows[0]]))), int(fit.rows[0]), fit.q, fit.w
    row = settled_epoch(start)
    return row, int(np.searchsorted(problem.times, start.times[row] - 1e-9)), start.q[row], start.w[row]


@dataclass(frozen=True)
class _Carried:
    """Whether feature points are filtered, which (m,), where they are in the start's body axes (m, 3), position and
    velocity of the centre of mass, and the covariance of all that is not rotation."""

    points: bool
    chosen: np.ndarray
    features: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    others: np.ndarray


def _carried(problem: Problem, start: Start, row: int, first: int, most: int, fit: FreeFit | None) -> _Carried:
    """What the filter carries besides rotation at epoch `first`, near the start's `row`."""
    if not problem.has_tracks or start.features is None or start.position is None:
        return _Carried(False, np.zeros(0, int), np.zeros((0, 3)), np.zeros(3), np.zeros(3), np.zeros((0, 0)))
    chosen = longest(start.features, problem.seen[first:].sum(axis=(0, 1)), most)
    rows, q = np.searchsorted(problem.times, start.times[row:] - 1e-9), start.q[row:]
    if fit is not None:
        rows, q = fit.rows, fit.path
    path = chaser_path(problem.environment, problem.times[rows])
    f = start.features[chosen]
    points, covariance = _measured_points(problem, start, rows, q, chosen, f)
    C = rotation_matrix(path.q)[:, None]
    x, spread = linear_path(
        problem.times[rows],
        multiply(path.q, q),
        (C @ points[..., None])[..., 0],
        C @ covariance @ np.swapaxes(C, -1, -2),
        path,
        3.0 * float(np.sqrt(np.mean(np.sum(f * f, axis=1)))),
    )
    back = block_diag(C[0, 0].T, C[0, 0].T, np.eye(3 * len(chosen)))
    x = back @ x
    return _Carried(True, chosen, x[6:].reshape(-1, 3), x[:3], x[3:6], WIDER**2 * back @ spread @ back.T)


def _measured_points(
    problem: Problem, start: Start, rows: np.ndarray, q: np.ndarray, chosen: np.ndarray, f: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Features `chosen` at the epochs `rows`, of attitudes q, in the chaser's frame (n, m, 3) and covariance (n, m, 3, 3).

    Two cameras triangulate them. One camera shows no depth: it is that of the start's path and features f (m, 3). All sights
    together leave it as uncertain as the body is deep where ranges will show it, and hold it where it is only a unit.
    """
    uv = np.moveaxis(problem.uv[rows][:, :, chosen], 1, 2)
    if problem.stereo:
        return triangulate(problem.cameras, uv, problem.sigma_px)
    assert start.position is not None
    camera = problem.cameras[0]
    path = np.stack([np.interp(problem.times[rows], start.times, x) for x in start.position.T], axis=1)
    X = path[:, None] + np.einsum("nij,mj->nmi", rotation_matrix(q), f)
    deep = float(np.sqrt(np.mean(np.sum(f * f, axis=1)) * np.isfinite(uv[..., 0, 0]).sum()))
    along = deep if start.scaled else UNIT * deep
    return at_depth(camera, uv[..., 0, :], (X - camera.t) @ camera.R[2], problem.alike * problem.sigma_px[0], along)


def _turning(
    problem: Problem, prior: Prior, start: Start, fit: FreeFit | None, row: int
) -> tuple[np.ndarray, np.ndarray]:
    """The five numbers of the inertia, and the covariance (11, 11) of rates, attitude and these.

    Raises:
        NotPossible: nothing shows an inertia.
    """
    P, widest = np.zeros((11, 11)), WIDEST_K**2 * np.eye(5)
    inertia = start.inertia if fit is None else fit.inertia
    if prior.inertia is not None:
        inertia = prior.inertia
    if inertia is None:
        raise NotPossible("the first epochs show no inertia to start from: give a longer record, or --prior")
    numbers = cholesky_parameters(inertia)
    to_numbers = np.linalg.inv(np.einsum("aij,pij->ap", DIRECTIONS, cholesky_changes(numbers)))
    if fit is not None and prior.inertia is None:
        G = block_diag(np.eye(6)[[3, 4, 5, 0, 1, 2]], to_numbers)
        P = _limited(WIDER**2 * G @ fit.covariance @ G.T, widest)
    else:
        rotation = start.covariance[row] if fit is None else fit.covariance[:6, :6]
        P[np.arange(6), np.arange(6)] = _rotation_variances(rotation, start)
        P[6:, 6:] = widest
        if prior.inertia is not None:
            P[6:, 6:] = _prior_covariance(prior, numbers)
        elif start.momentum is not None:
            P[6:, 6:] = (WIDER * problem.alike) ** 2 * to_numbers @ start.momentum.covariance @ to_numbers.T
            P = _limited(P, widest)
    return numbers, P + 1e-18 * np.eye(11)


def _limited(P: np.ndarray, widest: np.ndarray) -> np.ndarray:
    """P with its last block nowhere wider than `widest`, as if the mean of that had been measured so: with a motion that hardly
    shows the inertia, what is known of it begins at knowing nothing."""
    n = len(widest)
    gain = P[:, -n:] @ np.linalg.inv(P[-n:, -n:] + widest)
    less = P - gain @ P[-n:]
    return 0.5 * (less + less.T)


def _rotation_variances(covariance: np.ndarray, start: Start) -> np.ndarray:
    """(6,) of rates and attitude to start with, from the covariance of attitude and rates (6, 6)."""
    spread = WIDER * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    attitude = 1e-6 if start.poses is None else max(spread[:3].max(), 1e-6)
    return np.repeat([max(spread[3:].max(), 1e-9), attitude], 3) ** 2


def _noise(problem: Problem, prior: Prior, start: Start) -> Noise:
    turn, drift = noise_densities(problem, prior, start)
    step = float(np.median(np.diff(problem.times)))
    return Noise(w=turn**2, attitude=turn**2 * step**2 / 3.0, k=1e-14, velocity=drift**2)


def _prior_covariance(prior: Prior, numbers: np.ndarray) -> np.ndarray:
    """(5, 5) of the five numbers: what the prior says of ratios and axes, and no more than is known of any body."""
    k = np.full(2, WIDEST_K) if prior.k_sigma is None else np.minimum(prior.k_sigma, 1.0)
    axes = np.full(3, WIDEST_K) if prior.axes_sigma is None else np.minimum(prior.axes_sigma, WIDEST_K)
    return inertia_covariance(numbers, k, axes)


def measurements(
    problem: Problem, setup: Setup, begin: int, end: int, chosen: np.ndarray, fresh: bool = False
) -> Measurements:
    """Epochs begin to end with the features `chosen`; `fresh` when the state stands at the first of them already."""
    rows = slice(begin, end)
    times = problem.times[rows]
    n = end - begin
    before = begin if fresh or begin == 0 else begin - 1
    dt = np.diff(problem.times[rows], prepend=problem.times[before])
    blocks, variances = [], []
    attitude = None
    if setup.sensors[0]:
        attitude = np.where(np.isfinite(problem.attitude[rows]), problem.attitude[rows], 0.0)
        blocks.append(np.repeat(np.where(np.isfinite(problem.attitude[rows, :1]), 0.0, np.nan), 3, axis=1))
        variances.append(np.repeat(problem.sigma_attitude[rows, None] ** 2, 3, axis=1) / setup.share[1])
    if setup.sensors[1]:
        blocks.append(problem.rates[rows])
        variances.append(np.full((n, 3), problem.sigma_rate**2))
    if setup.sensors[2]:
        blocks.append(problem.range_m[rows, None])
        variances.append(np.full((n, 1), problem.sigma_range**2))
    cameras = problem.cameras if setup.points else ()
    if setup.points:
        uv = problem.uv[rows][:, :, chosen]
        blocks.append(np.moveaxis(uv, 1, 2).reshape(n, -1))
        # one camera's tracks are those that its attitudes were found from (as in `batch.matched_tracks`)
        alike = 1.0 if problem.stereo else problem.alike
        variance = np.repeat((alike * problem.sigma_px) ** 2, 2) / setup.share[0]
        variances.append(np.tile(variance, (n, len(chosen))))
    steps = chaser_steps(problem.environment, np.concatenate([[problem.times[before]], times]))
    return Measurements(
        dt,
        np.concatenate(blocks, axis=1),
        np.concatenate(variances, axis=1),
        cameras,
        attitude,
        rates=setup.sensors[1],
        range=setup.sensors[2],
        transition=steps.transition,
        spin=steps.spin,
        chaser=steps.chaser,
    )


@dataclass(frozen=True)
class ChaserSteps:
    """What a step does to vectors in the chaser's axes: transition of relative position and velocity (n, 6, 6), turn of the
    chaser (n, 4), and where it is over the step (n, 10), as of `rule.Steps`; all None without an orbit."""

    transition: np.ndarray | None = None
    spin: np.ndarray | None = None
    chaser: np.ndarray | None = None


def chaser_steps(environment: Environment, times: np.ndarray, camera: np.ndarray | None = None) -> ChaserSteps:
    """The steps between n + 1 times [s].

    Args:
        camera: (n + 1, 4) attitude of cam0, to inertial axes, where it is not the environment's.
    """
    path, mid = chaser_path(environment, times), chaser_path(environment, 0.5 * (times[1:] + times[:-1]))
    turning = path.q if camera is None else camera
    if environment.orbit is None and camera is None:
        return ChaserSteps()
    spin = multiply(conjugate(turning[1:]), turning[:-1])
    before, after = rotation_matrix(turning[:-1]), rotation_matrix(turning[1:])
    F = transitions(path, times).reshape(-1, 2, 3, 2, 3)
    F = np.einsum("nji,najbk,nkl->naibl", after, F, before).reshape(-1, 6, 6)
    places = np.stack([path.place[:-1], mid.place, path.place[1:]], axis=1) @ before
    return ChaserSteps(F, spin, np.concatenate([places.reshape(-1, 9), np.full((len(places), 1), path.mu)], axis=1))
