"""From a problem and a first guess to the filter's state, measurements and process noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply, rotation_matrix, skew
from massprops.errors import NotPossible
from massprops.estimators.begin import (
    WIDER,
    WIDEST_K,
    longest,
    point_sigma,
    ratio_sigmas,
    restlessness,
    settled_epoch,
)
from massprops.estimators.chaser_path import chaser_path
from massprops.estimators.free_fit import FreeFit, free_fit
from massprops.estimators.momentum import DIRECTIONS
from massprops.estimators.problem import Problem
from massprops.estimators.result import Prior, ratios
from massprops.estimators.unscented.state import Measurements, Noise, State

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


def setup(problem: Problem, prior: Prior, start: Any, most: int = MOST_FEATURES) -> Setup:
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
        raise NotPossible("ukf: the first guess found no rotation to start from")
    fit = free_fit(problem, start)
    inertia = start.inertia if fit is None else fit.inertia
    if prior.inertia is not None:
        inertia = prior.inertia
    if inertia is None:
        raise NotPossible("ukf: the first guess found no inertia to start from")
    k, frame = ratios(inertia)
    if np.linalg.det(frame) < 0:
        frame = frame * np.array([1.0, 1.0, -1.0])
    if fit is None:
        row = settled_epoch(start)
        first = int(np.searchsorted(problem.times, start.times[row] - 1e-9))
        q, w = start.q[row], start.w[row]
    else:
        row = int(np.argmin(np.abs(start.times - problem.times[fit.rows[0]])))
        first, q, w = int(fit.rows[0]), fit.q, fit.w
    seen = _carried(problem, start, row, first, most)
    # the principal frame belongs to the dynamics: tracks do not fix it, so features and attitude turn with it
    features = seen.features @ frame
    if fit is not None and prior.inertia is None:
        P, k_sigma = _fitted_covariance(fit, frame, k, features, seen.others)
    else:
        rotation = start.covariance[row] if fit is None else fit.covariance[:6, :6]
        k_sigma, axes_sigma = _sigmas(prior, start, inertia, frame)
        sigma = np.concatenate([*_rotation_sigmas(rotation, problem, seen.points), k_sigma, seen.others])
        P = _with_frame(np.diag(sigma**2), features, w @ frame, axes_sigma, frame)
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
    # imu0 and the tracks need not share body axes
    points = seen.points
    sensors = (not points and problem.has_attitude, not points and problem.has_rates, points and problem.has_range)
    noise = _noise(problem, prior, start)
    return Setup(state, seen.chosen, noise, first, seen.points, sensors, frame, k_sigma, tuple(start.warnings))


@dataclass(frozen=True)
class _Carried:
    """Whether stereo points are filtered, which (m,), where they are in the start's body axes (m, 3), position and
    velocity of the centre of mass, and the 1-sigma of all that is not rotation."""

    points: bool
    chosen: np.ndarray
    features: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    others: np.ndarray


def _carried(problem: Problem, start: Any, row: int, first: int, most: int) -> _Carried:
    """What the filter carries besides rotation at epoch `first`, near the start's `row`."""
    if not (problem.stereo and start.features is not None and start.position is not None):
        return _Carried(False, np.zeros(0, int), np.zeros((0, 3)), np.zeros(3), np.zeros(3), np.full(3, 1e-9))
    chosen = longest(start.features, problem.seen[first:].sum(axis=(0, 1)), most)
    velocity = np.zeros(3) if start.velocity is None else start.velocity
    position = start.position[row]
    if start.velocity is not None:
        position = position + (problem.times[first] - start.times[row]) * velocity
    place = point_sigma(problem, float(np.linalg.norm(position)))
    length = max(float(start.times[-1] - start.times[0]), 1e-9)
    others = [np.full(3, place), np.full(3, 10 * place / length), np.full(3 * len(chosen), place)]
    return _Carried(True, chosen, start.features[chosen], position, velocity, np.concatenate(others))


def _rotation_sigmas(covariance: np.ndarray, problem: Problem, points: bool) -> tuple[np.ndarray, np.ndarray]:
    """1-sigma of rates and attitude (3,) to start with, from the covariance of attitude and rates (6, 6)."""
    spread = WIDER * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    attitude = max(spread[:3].max(), 1e-6) if points or problem.has_attitude else 1e-6
    return np.full(3, max(spread[3:].max(), 1e-9)), np.full(3, attitude)


def _noise(problem: Problem, prior: Prior, start: Any) -> Noise:
    push, drift = restlessness(problem, prior, start)
    step = float(np.median(np.diff(problem.times)))
    return Noise(w=push**2, attitude=push**2 * step**2 / 3.0, k=1e-14, velocity=drift**2)


def _fitted_covariance(
    fit: FreeFit, frame: np.ndarray, k: np.ndarray, features: np.ndarray, others: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """P of rates, attitude, ratios and principal frame together from the fit, widened, with the `others` apart.

    Returns:
        P (N, N), and the 1-sigma of k1, k2 (2,).
    """
    moments = np.array([np.exp(k[0]), 1.0, np.exp(-k[1])])
    moments *= np.trace(fit.inertia) / moments.sum()
    inside = np.einsum("ia,nij,jb->nab", frame, DIRECTIONS, frame)  # each direction in principal axes
    share = np.einsum("naa->an", inside) / moments[:, None]
    to_k = np.array([share[0] - share[1], share[1] - share[2]])
    # a small turn t of the axes changes the tensor's element ij by (I_i - I_j) times the turn about the third axis
    turns = []
    for i, j in ((1, 2), (2, 0), (0, 1)):
        gap = moments[i] - moments[j]
        turns.append(inside[:, i, j] / gap if abs(gap) > 1e-9 else np.full(5, 1e9))
    to_turn = np.array(turns)
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
    P[np.arange(8, len(P)), np.arange(8, len(P))] += others**2
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
    return P + (J * axes_sigma**2) @ J.T


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
    transition, spin = chaser_steps(problem, np.concatenate([[problem.times[before]], times]))
    return Measurements(
        dt,
        np.concatenate(blocks, axis=1),
        np.concatenate(variances, axis=1),
        cameras,
        attitude,
        rates=setup.sensors[1],
        range=setup.sensors[2],
        transition=transition,
        spin=spin,
    )


def chaser_steps(problem: Problem, times: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Transition of relative position and velocity (n, 6, 6), and turn of the chaser (n, 4), between n + 1 times.

    Gravity is taken to first order in the distance, which is to one part in 10^5 for metres against an orbit.
    """
    environment = problem.environment
    if environment.orbit is None:
        return None, None
    path = chaser_path(environment, problem.times)
    at = np.clip(np.searchsorted(problem.times, times - 1e-9), 0, len(problem.times) - 1)
    if not np.allclose(problem.times[at], times, atol=1e-6):
        path = chaser_path(environment, np.concatenate([[problem.times[0]], times]))
        at = 1 + np.arange(len(times))
    spin = multiply(conjugate(path.q[at[1:]]), path.q[at[:-1]])
    turn = rotation_matrix(spin)
    here = np.einsum("nji,nj->ni", rotation_matrix(path.q[at[:-1]]), path.place[at[:-1]])
    distance = np.linalg.norm(here, axis=1)[:, None]
    up = here / distance
    pull = path.mu / distance[..., None] ** 3 * (3.0 * up[:, :, None] * up[:, None, :] - np.eye(3))
    h = np.diff(times)[:, None, None]
    F = np.zeros((len(h), 6, 6))
    eye = np.eye(3)
    F[:, :3, :3], F[:, :3, 3:] = eye + 0.5 * h**2 * pull, h * eye + h**3 / 6.0 * pull
    F[:, 3:, :3], F[:, 3:, 3:] = h * pull, eye + 0.5 * h**2 * pull
    F[:, :3], F[:, 3:] = turn @ F[:, :3], turn @ F[:, 3:]
    return F, spin
