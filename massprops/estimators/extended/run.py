"""The EKF and the iterated EKF over a problem's epochs: features that come and go, outliers, missing sensors."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics.quaternion import from_rotation_matrix
from massprops.estimators.extended.curvature import image_curvature
from massprops.estimators.extended.error_state import State
from massprops.estimators.extended.observation import attitude, body_rate, distance, images
from massprops.estimators.extended.setup import Setup, body_points, place_feature
from massprops.estimators.extended.transition import predict
from massprops.estimators.extended.update import Observe, Rule, innovations, square_root, update, whitened
from massprops.model.problem import Problem

LIMIT = {1: 11.0, 2: 18.4, 3: 21.1}
"""Squared innovation over its covariance beyond which a measurement is an outlier, by its numbers: one good one in
ten thousand (1: in a thousand) goes too."""
MISSES = 3
"""Refusals in a row after which a feature is given up and placed anew: its track, or its place, was wrong."""

MAJORITY = 0.5
"""Share of an epoch's features beyond the limit at which it is the filter that is wrong: its covariance grows instead."""


@dataclass(frozen=True)
class Passage:
    """A run of the filter; n epochs.

    Attributes:
        states: after each epoch's measurements; P: (n, s, s).
        points: (features, 3) each feature as last known, from the centre of mass in body axes, NaN if never carried.
        squares, numbers: (n,) sum of squared innovations that passed, and how many numbers they hold.
        gated: (n,) numbers refused. cpu_s: CPU time of the run.
    """

    states: list[State]
    P: np.ndarray
    points: np.ndarray
    squares: np.ndarray
    numbers: np.ndarray
    gated: np.ndarray
    cpu_s: float


def run_through(problem: Problem, setup: Setup, rule: Rule, second_order: bool) -> Passage:
    """The filter from epoch `setup.first` to the last."""
    begun = time.process_time()
    state, P, slots = setup.state, setup.P, setup.slots.copy()
    last_seen = _last_seen(problem)
    n = len(problem.times) - setup.first
    points = np.full((problem.uv.shape[2], 3), np.nan)
    states: list[State] = []
    covariances = np.empty((n, *P.shape[1:]))
    squares, numbers, gated = np.zeros(n), np.zeros(n, int), np.zeros(n, int)
    misses = np.zeros(len(slots), int)
    leaders = setup.surroundings.leaders(problem.times[setup.first :])
    for step, epoch in enumerate(range(setup.first, len(problem.times))):
        if step:
            state, P = predict(
                setup.layout,
                state,
                P,
                float(problem.times[epoch - 1]),
                float(problem.times[epoch]),
                setup.surroundings,
                setup.noise,
                setup.largest_rate,
                None if leaders is None else leaders[step - 1],
            )
        if setup.points:
            state, P = _newcomers(problem, setup, epoch, state, P, slots, last_seen, points)
        observe, sigma, groups = _channels(problem, setup, epoch, slots)
        if np.isfinite(sigma).any():
            bend = None
            if second_order and setup.points:
                bend = _bend(problem, setup, epoch, state, P, sigma.shape[1])
            wide = sigma if bend is None else np.sqrt(sigma**2 + bend[1])
            P, S, keep, counts = _gate(state, P, observe, wide, groups)
            squares[step], numbers[step], gated[step] = counts
            if setup.points:
                _give_up(slots, misses, np.isfinite(sigma), keep, len(problem.cameras))
            done = update(setup.layout, state, P, observe, np.where(keep, sigma, np.inf), rule, bend, root=S)
            if np.isfinite(done.P).all() and np.isfinite(done.state.W).all():
                state, P = done.state, done.P
        states.append(state)
        covariances[step] = P[0]
    if setup.points:
        held = slots >= 0
        points[slots[held]] = body_points(state)[held]
    return Passage(states, covariances, points, squares, numbers, gated, time.process_time() - begun)


def _channels(problem: Problem, setup: Setup, epoch: int, slots: np.ndarray) -> tuple[Observe, np.ndarray, list[int]]:
    """Residuals of one epoch, their sigmas (1, rows), and the rows' grouping: how many numbers go together."""
    C, spin = setup.surroundings.camera_frame(float(problem.times[epoch]))
    layout, cameras = setup.layout, problem.cameras
    parts, groups = [], []
    if setup.points:
        uv = np.where((slots >= 0)[:, None], problem.uv[epoch][:, slots], np.nan)
        z = uv.reshape(1, -1)
        # one camera's tracks are those that its attitudes were found from (as in `batch.one_camera`)
        alike = 1.0 if problem.stereo else problem.alike
        noise = alike * np.repeat(problem.sigma_px, 2 * len(slots))[None] / np.sqrt(setup.share[0])
        parts.append(np.where(np.isfinite(z), noise, np.inf))
        groups += [2] * (len(cameras) * len(slots))
    measured = problem.attitude[epoch][None]
    told = setup.share[1] > 0 and np.isfinite(measured).all() and problem.sigma_attitude[epoch] > 0
    if told:
        parts.append(np.full((1, 3), problem.sigma_attitude[epoch] / np.sqrt(setup.share[1])))
        groups.append(3)
    rates = problem.rates[epoch][None]
    spinning = setup.rates and np.isfinite(rates).all()
    if spinning:
        parts.append(np.full((1, 3), problem.sigma_rate))
        groups.append(3)
    far = problem.range_m[epoch]
    ranged = setup.ranges and np.isfinite(far)
    if ranged:
        parts.append(np.full((1, 1), problem.sigma_range))
        groups.append(1)

    last: list[tuple[State, tuple[np.ndarray, np.ndarray]]] = []

    def observe(state: State, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # the innovation test and the update's first step ask for the same state
        if last and last[0][0] is state:
            return last[0][1]
        last[:] = [(state, measured_against(state))]
        return last[0][1]

    def measured_against(state: State) -> tuple[np.ndarray, np.ndarray]:
        residual, slope = [], []
        if setup.points:
            value, H, front = images(layout, state, cameras, C, spin)
            residual.append(np.where(front, np.nan_to_num(z - value), 1e6 * np.isfinite(z)))
            slope.append(H)
        if told:
            value, H = attitude(layout, state, from_rotation_matrix(C)[None], measured)
            residual.append(value)
            slope.append(H)
        if spinning:
            value, H = body_rate(layout, state)
            residual.append(rates - value)
            slope.append(H)
        if ranged:
            value, H = distance(layout, state)
            residual.append(far - value)
            slope.append(H)
        return np.concatenate(residual, axis=1), np.concatenate(slope, axis=1)

    sigma = np.concatenate(parts, axis=1) if parts else np.full((1, 1), np.inf)
    return observe, sigma, groups


def _give_up(slots: np.ndarray, misses: np.ndarray, measured: np.ndarray, keep: np.ndarray, cameras: int) -> None:
    """Empties the slots of features that have been refused too often in a row."""
    rows = 2 * cameras * len(slots)
    there = measured[0, :rows].reshape(cameras, len(slots), 2)[..., 0].any(axis=0)
    passed = keep[0, :rows].reshape(cameras, len(slots), 2)[..., 0].any(axis=0)
    misses[:] = np.where(there, np.where(passed, 0, misses + 1), misses)
    gone = misses >= MISSES
    slots[gone], misses[gone] = -1, 0


def _bend(
    problem: Problem, setup: Setup, epoch: int, state: State, P: np.ndarray, rows: int
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the second order, zero for what is not an image."""
    C, spin = setup.surroundings.camera_frame(float(problem.times[epoch]))
    mean, spread = np.zeros((1, rows)), np.zeros((1, rows))
    own = image_curvature(setup.layout, state, P, problem.cameras, C, spin)
    mean[:, : own[0].shape[1]], spread[:, : own[1].shape[1]] = own
    return mean, spread


def _gate(
    state: State, P: np.ndarray, observe: Observe, sigma: np.ndarray, groups: list[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[float, int, int]]:
    """Covariance and its square root, rows to use (1, rows), and (squared innovations used, how many numbers, how many
    refused)."""
    size = np.array(groups)
    edges = np.concatenate([[0], np.cumsum(size)])
    keep = np.isfinite(sigma)
    limit = np.array([LIMIT[g] for g in groups])
    S = square_root(P)
    residual, A = whitened(observe, state, sigma, S)
    value, held = innovations(residual, A, keep, groups)
    there = held & (size == 2)
    there = there if there.sum() >= 3 else held
    wrong = held & (value > limit)
    if (wrong & there).sum() > MAJORITY * there.sum():
        wider = max(1.0, float(np.median(value[there] / size[there])) / 0.7)
        P, S, A = P * wider, S * np.sqrt(wider), A * np.sqrt(wider)
        value, held = innovations(residual, A, keep, groups)
        wrong = held & (value > limit)
    for g in np.flatnonzero(wrong):
        keep[:, edges[g] : edges[g + 1]] = False
    good = held & ~wrong
    return P, S, keep, (float(value[good].sum()), int(size[good].sum()), int(size[wrong].sum()))


def _last_seen(problem: Problem) -> np.ndarray:
    """(features,) last epoch at which each is seen."""
    seen: np.ndarray = problem.seen.any(axis=1)
    return (
        np.where(seen.any(axis=0), len(seen) - 1 - np.argmax(seen[::-1], axis=0), -1) if seen.size else np.zeros(0, int)
    )


def _newcomers(
    problem: Problem,
    setup: Setup,
    epoch: int,
    state: State,
    P: np.ndarray,
    slots: np.ndarray,
    last_seen: np.ndarray,
    points: np.ndarray,
) -> tuple[State, np.ndarray]:
    """Features at their first sight take empty slots, or those of features that are not seen any more."""
    free = [i for i in range(len(slots)) if slots[i] < 0 or last_seen[slots[i]] < epoch]
    if not free:
        return state, P
    seen = problem.seen[epoch]
    there = np.flatnonzero(seen.all(axis=0) if problem.stereo else seen[0])
    carried = set(slots.tolist())
    waiting = [f for f in there if f not in carried and last_seen[f] > epoch + 2]
    waiting.sort(key=lambda f: (-last_seen[f], f))
    placed = 0
    for feature in waiting:
        if placed == len(free):
            break
        found = place_feature(setup, problem, epoch, int(feature), state)
        if found is None:
            continue
        slot = free[placed]
        placed += 1
        if slots[slot] >= 0:
            points[slots[slot]] = body_points(state)[slot]
        slots[slot] = feature
        X = state.X.copy()
        X[0, slot] = found[0]
        state = replace(state, X=X)
        at = slice(setup.layout.x.start + 3 * slot, setup.layout.x.start + 3 * slot + 3)
        P = P.copy()
        P[:, at, :] = 0.0
        P[:, :, at] = 0.0
        P[:, at, at] = found[1]
    return state, P
