"""From a problem and a first guess to the filter's state, measurements and process noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.inertia import DIRECTIONS, principal_axes, ratio_derivatives, ratios_of_moments
from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply, rotation_matrix, skew
from massprops.errors import NotPossible
from massprops.estimators.filters.begin import (
    WIDER,
    WIDEST_K,
    longest,
    noise_densities,
    ratio_sigmas,
    settled_epoch,
)
from massprops.estimators.filters.state import Measurements, Noise, State
from massprops.estimators.free_fit import FreeFit, free_fit
from massprops.estimators.geometry.stereo_path import linear_path
from massprops.estimators.result import Prior
from massprops.model.problem import Problem
from massprops.sensing.stereo import triangulate
from massprops.sequence.data import Environment

MOST_FEATURES = 16
"""Features carried at a time."""


@dataclass(frozen=True)
class Setup:
    """A filter ready to run over epochs `first` and later.

    Attributes:
        state: before the measurements of epoch `first`.
        chosen: columns of the problem's features in the state.
        noise: process noise. first: epoch. points: stereo features are measured (or attitude0, imu0).
        sensors: (attitude, rates, range) used. transition: (n, 6, 6), spin: (n, 4) over the step to each epoch.
        frame: (3, 3) principal axes in the first guess's body axes. k_sigma: (2,) 1-sigma of k at the start.
    """

    state: State
    chosen: np.ndarray
    noise: Noise
    first: int
    points: bool
    sensors: tuple[bool, bool, bool]
    frame: np.ndarray
    k_sigma: np.ndarray
    warnings: tuple[str, ...] = ()


def setup(
    problem: Problem,
    prior: Prior,
    start: Any,
    most: int = MOST_FEATURES,
    principal: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] = principal_axes,
) -> Setup:
    """State and noise to begin with.

    Args:
        problem: the measurements.
        prior: beliefs; its inertia, where given, with its own sigmas.
        start: first guess, see `massprops.estimators.start`.
        most: features carried at a time.
        principal: moments and axes of an inertia, in the order and with the signs that the filter's axes shall have.

    Raises:
        NotPossible: no rotation or no inertia in the first guess.
    """
    if not len(start.q):
        raise NotPossible("the first epochs show no rotation to start from: give a longer record, or more features")
    fit = free_fit(problem, start)
    inertia = start.inertia if fit is None else fit.inertia
    if prior.inertia is not None:
        inertia = prior.inertia
    if inertia is None:
        raise NotPossible("the first epochs show no inertia to start from: give a longer record, or --prior")
    moments, frame = principal(inertia)
    k = ratios_of_moments(moments)
    row, first, q, w = _first_rotation(problem, start, fit)
    seen = _carried(problem, start, row, first, most, fit)
    # the principal frame belongs to the dynamics: tracks do not fix it, so features and attitude turn with it
    features, turned = seen.features @ frame, np.eye(len(seen.others))
    for i in range(6, len(turned), 3):
        turned[i : i + 3, i : i + 3] = frame.T
    others = turned @ seen.others @ turned.T
    if fit is not None and prior.inertia is None:
        P, k_sigma = _fitted_covariance(fit, frame, k, features, others)
    else:
        rotation = start.covariance[row] if fit is None else fit.covariance[:6, :6]
        k_sigma, axes_sigma = _sigmas(prior, start, inertia, frame)
        sigma = np.concatenate([*_rotation_sigmas(rotation, problem, seen.points), k_sigma])
        P = _with_frame(block_diag(np.diag(sigma**2), others), features, w @ frame, axes_sigma, frame)
    turn = from_rotation_matrix(frame)
    state = State(
        w=w @ frame,
        q=multiply(q, turn),
        k=k,
        features=features,
        P=P,
        axes=np.array([1.0, 0, 0, 0]) if seen.points else conjugate(turn),
        position=seen.position,
        velocity=seen.velocity,
        axes_free=not seen.points,
        moving=seen.points,
    )
    points, noise = seen.points, _noise(problem, prior, start)
    # imu0 and the tracks need not share body axes
    sensors = (not points and problem.has_attitude, not points and problem.has_rates, points and problem.has_range)
    return Setup(state, seen.chosen, noise, first, points, sensors, frame, k_sigma, tuple(start.warnings))


def _first_rotation(problem: Problem, start: Any, fit: FreeFit | None) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Row of the start and epoch of the problem where the filter begins, and attitude (4,) and rates (3,) there."""
    if fit is not None:
        return int(np.argmin(np.abs(start.times - problem.times[fit.rows[0]]))), int(fit.rows[0]), fit.q, fit.w
    row = settled_epoch(start)
    return row, int(np.searchsorted(problem.times, start.times[row] - 1e-9)), start.q[row], start.w[row]


@dataclass(frozen=True)
class _Carried:
    """Whether stereo points are filtered, which (m,), where they are in the start's body axes (m, 3), position and
    velocity of the centre of mass, and the covariance of all that is not rotation."""

    points: bool
    chosen: np.ndarray
    features: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    others: np.ndarray


def _carried(problem: Problem, start: Any, row: int, first: int, most: int, fit: FreeFit | None) -> _Carried:
    """What the filter carries besides rotation at epoch `first`, near the start's `row`."""
    if not (problem.stereo and start.features is not None and start.position is not None):
        return _Carried(False, np.zeros(0, int), np.zeros((0, 3)), np.zeros(3), np.zeros(3), 1e-18 * np.eye(3))
    chosen = longest(start.features, problem.seen[first:].sum(axis=(0, 1)), most)
    rows, q = np.searchsorted(problem.times, start.times[row:] - 1e-9), start.q[row:]
    if fit is not None:
        rows, q = fit.rows, fit.path
    path = chaser_path(problem.environment, problem.times[rows])
    points, covariance = triangulate(
        problem.cameras, np.moveaxis(problem.uv[rows][:, :, chosen], 1, 2), problem.sigma_px
    )
    C = rotation_matrix(path.q)[:, None]
    f = start.features[chosen]
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


def _rotation_sigmas(covariance: np.ndarray, problem: Problem, points: bool) -> tuple[np.ndarray, np.ndarray]:
    """1-sigma of rates and attitude (3,) to start with, from the covariance of attitude and rates (6, 6)."""
    spread = WIDER * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    attitude = max(spread[:3].max(), 1e-6) if points or problem.has_attitude else 1e-6
    return np.full(3, max(spread[3:].max(), 1e-9)), np.full(3, attitude)


def _noise(problem: Problem, prior: Prior, start: Any) -> Noise:
    turn, drift = noise_densities(problem, prior, start)
    step = float(np.median(np.diff(problem.times)))
    return Noise(w=turn**2, attitude=turn**2 * step**2 / 3.0, k=1e-14, velocity=drift**2)


def _fitted_covariance(
    fit: FreeFit, frame: np.ndarray, k: np.ndarray, features: np.ndarray, others: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """P of rates, attitude, ratios and principal frame together from the fit, widened, with that of the `others` apart.

    Returns:
        P (N, N), and the 1-sigma of k1, k2 (2,).
    """
    moments = np.array([np.exp(k[0]), 1.0, np.exp(-k[1])])
    moments *= np.trace(fit.inertia) / moments.sum()
    to_k, to_turn = ratio_derivatives(moments, frame, DIRECTIONS)
    sigma = WIDER * np.sqrt(np.einsum("ai,ij,aj->a", to_turn, fit.covariance[6:, 6:], to_turn))
    free = sigma > WIDEST_K
    to_turn[free] = 0.0
    G = np.zeros((8 + len(others), 11))
    w = frame.T @ fit.w
    theta = np.zeros((3, 11))
    theta[:, 6:] = to_turn
    G[:3, 3:6], G[3:6, :3], G[6:8, 6:] = frame.T, frame.T, to_k
    lever = _lever(len(G), features, w, frame)
    G += lever @ theta
    P = WIDER**2 * G @ fit.covariance @ G.T
    P += (lever * np.where(free, WIDEST_K, 0.0) ** 2) @ lever.T
    P[8:, 8:] += others
    P[np.arange(8), np.arange(8)] += 1e-18
    k_sigma = np.sqrt(np.diag(P)[6:8])
    over = np.concatenate([np.ones(6), np.minimum(1.0, WIDEST_K / k_sigma), np.ones(len(others))])
    return P * np.outer(over, over), np.minimum(k_sigma, WIDEST_K)


def _lever(size: int, features: np.ndarray, w: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """(N, 3): what a turn of the principal frame in the body does to rates, attitude, axes and features."""
    J = np.zeros((size, 3))
    J[3:6] = np.eye(3)
    J[:3] = skew(w)
    if size == 11:
        J[8:11] = -frame
    for i, p in enumerate(features):
        J[14 + 3 * i : 17 + 3 * i] = skew(p)
    return J


def _with_frame(
    P: np.ndarray, features: np.ndarray, w: np.ndarray, axes_sigma: np.ndarray, frame: np.ndarray
) -> np.ndarray:
    """Adds the doubt about where the principal axes lie in the body: it turns attitude, rates, axes and features."""
    J = _lever(len(P), features, w, frame)
    found: np.ndarray = P + (J * axes_sigma**2) @ J.T
    return found


def _sigmas(prior: Prior, start: Any, inertia: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """1-sigma of k1, k2 and of the axes (about the principal axes) to start with."""
    if prior.inertia is not None:
        k, axes = np.full(2, WIDEST_K), np.full(3, WIDEST_K)
        k = k if prior.k_sigma is None else np.asarray(prior.k_sigma, float)
        axes = axes if prior.axes_sigma is None else np.asarray(prior.axes_sigma, float)
        return np.minimum(k, 1.0), np.minimum(axes, WIDEST_K)
    return ratio_sigmas(start, inertia, frame)


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
        variances.append(np.repeat(problem.sigma_attitude[rows, None] ** 2, 3, axis=1))
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
        variances.append(np.tile(np.repeat(problem.sigma_px**2, 2), (n, len(chosen))))
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

    Gravity is taken to first order in the distance in the transition, which is to one part in 10^5 for metres against an
    orbit.

    Args:
        camera: (n + 1, 4) attitude of cam0, to inertial axes, where it is not the environment's.
    """
    path, mid = chaser_path(environment, times), chaser_path(environment, 0.5 * (times[1:] + times[:-1]))
    turning = path.q if camera is None else camera
    if environment.orbit is None and camera is None:
        return ChaserSteps()
    spin = multiply(conjugate(turning[1:]), turning[:-1])
    turn = rotation_matrix(spin)
    back = np.swapaxes(rotation_matrix(turning[:-1]), 1, 2)[:, None]
    places = (back @ np.stack([path.place[:-1], mid.place, path.place[1:]], axis=1)[..., None])[..., 0]
    chaser = np.concatenate([places.reshape(-1, 9), np.full((len(places), 1), path.mu)], axis=1)
    pull = np.zeros((len(places), 3, 3))
    if path.mu > 0:
        distance = np.linalg.norm(places[:, 0], axis=1)[:, None]
        up = places[:, 0] / distance
        pull = path.mu / distance[..., None] ** 3 * (3.0 * up[:, :, None] * up[:, None, :] - np.eye(3))
    h = np.diff(times)[:, None, None]
    F = np.zeros((len(h), 6, 6))
    eye = np.eye(3)
    F[:, :3, :3], F[:, :3, 3:] = eye + 0.5 * h**2 * pull, h * eye + h**3 / 6.0 * pull
    F[:, 3:, :3], F[:, 3:, 3:] = h * pull, eye + 0.5 * h**2 * pull
    F[:, :3], F[:, 3:] = turn @ F[:, :3], turn @ F[:, 3:]
    return ChaserSteps(F, spin, chaser)
