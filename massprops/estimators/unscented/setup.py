"""From a problem and a first guess to the filter's state, measurements and process noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators.chaser_path import chaser_path
from massprops.estimators.free_fit import FreeFit, free_fit
from massprops.estimators.momentum import DIRECTIONS, ratio_covariance
from massprops.estimators.problem import Problem
from massprops.estimators.result import Prior, ratios
from massprops.estimators.unscented.state import Measurements, Noise, State

WIDER = 3.0
"""The filter starts this many times wider than the first guess claims, for it reads the same data again."""
WIDEST_K = 0.3
"""1-sigma of k1 and k2 when nothing is known of them."""
QUIET = 1e-5
"""Unmodelled angular acceleration over the square of the rate [per sqrt(s)], where no process noise is given."""
ORBIT_PUSH, DRIFT_PUSH = 1e-7, 1e-6
"""Unmodelled acceleration [m/s^2 sqrt(s)] with the orbit known and without."""
FIRST_TURNS, FIRST_EPOCHS = 2.0, 40
"""The first guess is made from the data of so many turns and epochs."""
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


def early_start(problem: Problem, prior: Prior, given: Any) -> Any:
    """The first guess from the first part of the data only; the given one where that part does not show enough."""
    from massprops.estimators.start import first_guess

    if given.early is not None:
        return given.early
    speed = float(np.nanmedian(np.linalg.norm(given.w, axis=1)))
    begin = float(given.times[0])
    rows = min(FIRST_EPOCHS, len(given.times)) - 1
    until = max(begin + FIRST_TURNS * 2 * np.pi / max(speed, 1e-9), float(given.times[rows]))
    if until >= given.times[-1]:
        return given
    try:
        early = first_guess(problem, prior, until_s=until)
    except NotPossible:
        return given
    usable = early.inertia is not None and np.isfinite(early.w).all() and early.body_frame == given.body_frame
    return early if usable else given


def settled_epoch(start: Any) -> int:
    """The first row of the start whose rates are about as good as most; the ends of a record are worse."""
    spread = np.einsum("nii->n", start.covariance[:, 3:, 3:])
    return int(np.argmax(spread <= 1.5 * np.nanmedian(spread)))


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
    points = problem.stereo and start.features is not None and start.position is not None
    attitude = not points and problem.has_attitude
    # imu0 and the tracks need not share body axes
    rates = problem.has_rates and not points
    turn = from_rotation_matrix(frame)
    features, position, velocity = np.zeros((0, 3)), np.zeros(3), np.zeros(3)
    chosen = np.zeros(0, int)
    others = [np.full(3, 1e-9)]
    if points:
        # the principal frame belongs to the dynamics: tracks do not fix it, so features and attitude turn with it
        chosen = _longest(problem, start, first, most)
        features = start.features[chosen] @ frame
        velocity = np.zeros(3) if start.velocity is None else start.velocity
        position = start.position[row]
        if start.velocity is not None:
            position = position + (problem.times[first] - start.times[row]) * velocity
        place = point_sigma(problem, float(np.linalg.norm(position)))
        length = max(float(start.times[-1] - start.times[0]), 1e-9)
        others = [np.full(3, place), np.full(3, 10 * place / length), np.full(3 * len(chosen), place)]
    if fit is not None and prior.inertia is None:
        P, k_sigma = _fitted_covariance(fit, frame, k, features, np.concatenate(others))
    else:
        k_sigma, axes_sigma = _sigmas(prior, start, inertia, frame)
        spread = np.maximum(np.einsum("nii->ni", start.covariance)[row], 0.0)
        if fit is not None:
            spread = np.diag(fit.covariance)[:6]
        spread = WIDER * np.sqrt(spread)
        sigma = [np.full(3, max(spread[3:].max(), 1e-9)), np.full(3, max(spread[:3].max(), 1e-6)), k_sigma, *others]
        if not points and not attitude:
            sigma[1] = np.full(3, 1e-6)
        P = _with_frame(np.diag(np.concatenate(sigma) ** 2), features, w @ frame, axes_sigma, frame)
    speed = float(np.nanmedian(np.linalg.norm(start.w, axis=1)))
    push = prior.process_noise if prior.process_noise is not None else QUIET * speed**2
    drift = ORBIT_PUSH if problem.environment.orbit is not None else DRIFT_PUSH
    step = float(np.median(np.diff(problem.times)))
    noise = Noise(w=push**2, attitude=push**2 * step**2 / 3.0, k=1e-14, velocity=drift**2)
    state = State(
        w=w @ frame,
        q=multiply(q, turn),
        k=k,
        features=features,
        P=P,
        axes=np.array([1.0, 0, 0, 0]) if points else conjugate(turn),
        position=position,
        velocity=velocity,
        axes_free=not points,
        moving=points,
    )
    sensors = (attitude, rates, points and problem.has_range)
    return Setup(state, chosen, noise, first, points, sensors, frame, k_sigma, tuple(start.warnings))


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
    from massprops.estimators.extended.error_state import skew

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
    k, axes = np.full(2, WIDEST_K), np.full(3, WIDEST_K)
    if prior.inertia is not None:
        k = k if prior.k_sigma is None else np.asarray(prior.k_sigma, float)
        axes = axes if prior.axes_sigma is None else np.asarray(prior.axes_sigma, float)
        return np.minimum(k, 1.0), np.minimum(axes, WIDEST_K)
    if start.momentum is not None:
        k_covariance, axes_covariance, _ = ratio_covariance(inertia, start.momentum.covariance)
        k = np.minimum(k, WIDER * np.sqrt(np.maximum(np.diag(k_covariance), 0)) + 1e-6)
        axes = np.minimum(axes, WIDER * np.sqrt(np.maximum(np.diag(frame.T @ axes_covariance @ frame), 0)) + 1e-6)
    return k, axes


def point_sigma(problem: Problem, distance: float) -> float:
    """1-sigma in depth of one stereo point [m]."""
    base = float(np.linalg.norm(problem.cameras[1].t - problem.cameras[0].t))
    pixel = float(np.hypot(*(problem.sigma_px[:2] / [abs(c.intrinsics[0]) for c in problem.cameras])))
    return distance**2 * pixel / base


def _longest(problem: Problem, start: Any, first: int, most: int) -> np.ndarray:
    """Features placed by the start and seen soon, the longest seen first."""
    both = problem.seen[first:].sum(axis=(0, 1))
    known = np.isfinite(start.features[:, 0]) & (both > 0)
    order = np.lexsort((np.arange(len(both)), -both))
    return np.sort(order[known[order]][:most])


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
