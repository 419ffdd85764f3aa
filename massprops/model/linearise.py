"""Residuals of all measurements at a state, in units of their noise, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics import rotation, translation
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import conjugate, from_rotation_matrix, multiply, rotation_matrix, rotation_vector
from massprops.dynamics.sensitivities import sensitivities
from massprops.dynamics.translation import derivatives, in_rows
from massprops.model.measurements import Measurements
from massprops.model.problem import Problem
from massprops.model.state import BODY_SIZE, INERTIA, PLACE, RATE, TURN, VELOCITY, BatchState, inertia_directions
from massprops.sensing.predict import Motion, camera_turn, image, in_chaser, pixel_jacobian


@dataclass(frozen=True)
class Predicted:
    """A state carried through all epochs: motion, its rotation trajectory, derivatives of the path, feature shifts."""

    state: BatchState
    motion: Motion
    q: np.ndarray
    trajectory: rotation.Trajectory
    dr: np.ndarray
    dv: np.ndarray


@dataclass(frozen=True)
class Residuals:
    """Measured less predicted over 1-sigma: tracks (o, 2), range (k,), rates (k, 3), attitude (k, 3)."""

    tracks: np.ndarray
    range: np.ndarray
    rates: np.ndarray
    attitude: np.ndarray

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """Each kind as (k, dimension)."""
        return self.tracks, self.range[:, None], self.rates, self.attitude

    @property
    def norms_by_kind(self) -> tuple[np.ndarray, ...]:
        """(k,) of each kind, the length of each residual over the root of its dimension: what robust weights go by."""
        return tuple(np.sqrt(np.mean(part**2, axis=1)) for part in self.parts)

    @property
    def norms(self) -> np.ndarray:
        """`norms_by_kind` of all kinds, in the order of `parts`."""
        return np.concatenate(self.norms_by_kind)

    @property
    def squares(self) -> np.ndarray:
        """Sum of squares of each residual, in the order of `norms`."""
        return np.concatenate([np.sum(part**2, axis=1) for part in self.parts])


def predict(problem: Problem, state: BatchState, environment: EnvironmentModel) -> Predicted:
    """The motion of a state at all epochs of the problem."""
    model = state.model
    active, p = model.active, model.flat(True)
    path = rotation.trajectory(problem.times, state.q0, state.w0, state.inertia, active, p, environment)
    r, v, dr, dv = translation.path(problem.times, state.r0, state.v0, active, p, environment)
    motion = Motion(problem.times, rotation_matrix(path.q), path.w, r, v, environment.chaser_turn(problem.times))
    return Predicted(state, motion, path.q, path, dr, dv)


def body_points(at: Predicted, m: Measurements) -> np.ndarray:
    """(o, 3) feature points of the observations from the centre of mass at that time."""
    points = at.state.points[m.seen.feature]
    model = at.state.model
    p = model.flat(True)
    for effect, place, _ in model.active:
        if hasattr(effect, "shift"):
            points = points + in_rows(effect.shift(at.motion.times, p[place]), len(at.motion.times))[m.seen.epoch]
    return np.asarray(points)


def residuals(problem: Problem, m: Measurements, at: Predicted) -> Residuals:
    """Residuals of the measurements."""
    model = at.state.model
    sensed, p = model.sensed, model.flat(False)
    tracks = np.zeros((0, 2))
    if len(m.uv):
        X, _, _ = in_chaser(m.seen, at.motion, body_points(at, m), sensed, p)
        tracks = (m.uv - image(problem.cameras, m.seen.camera, X, sensed, p)) / m.sigma[:, None]
    return Residuals(tracks, *_others(problem, m, at))


def _others(problem: Problem, m: Measurements, at: Predicted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    model = at.state.model
    sensed, p = model.sensed, model.flat(False)
    ranges = np.zeros(0)
    if len(m.range_at):
        predicted = np.linalg.norm(at.motion.r[m.range_at], axis=1)
        for effect, place in sensed.hooks("range_offset"):
            predicted = predicted + effect.range_offset(at.motion.times[m.range_at], p[place])
        ranges = (problem.range_m[m.range_at] - predicted) / problem.sigma_range
    rates = (problem.rates[m.rate_at] - at.motion.w[m.rate_at]) / problem.sigma_rate
    attitude = np.zeros((0, 3))
    if len(m.attitude_at):
        seen = multiply(from_rotation_matrix(camera_turn(at.motion, sensed, p)[m.attitude_at]), at.q[m.attitude_at])
        off = rotation_vector(multiply(conjugate(seen), problem.attitude[m.attitude_at]))
        attitude = off / problem.sigma_attitude[m.attitude_at, None]
    return ranges, rates, attitude


@dataclass(frozen=True)
class Linear:
    """Residuals and the derivatives of the predictions over 1-sigma.

    Attributes:
        shared: (N, p) by all parameters but the points, rows in the order tracks (u, v), range, rates, attitude.
        point: (o, 2, 3) of each observation by its own feature point.
        value: (N,) residuals in the same order; unit: (N,) which measurement each row belongs to (order of `norms`).
    """

    residuals: Residuals
    shared: np.ndarray
    point: np.ndarray
    value: np.ndarray
    unit: np.ndarray


def linearise(problem: Problem, m: Measurements, at: Predicted, environment: EnvironmentModel) -> Linear:
    """Residuals and derivatives at a predicted state."""
    by = Slopes(problem, at, environment)
    blocks, values = [], []
    point, tracks = np.zeros((0, 2, 3)), np.zeros((0, 2))
    if len(m.uv):
        tracks, J, point = _of_tracks(problem, m, at, by)
        blocks.append(J.reshape(-1, by.size))
        values.append(tracks.reshape(-1))
    ranges, rates, attitude = _others(problem, m, at)
    if len(m.range_at):
        blocks.append(_of_ranges(problem, m, at, by) / problem.sigma_range)
        values.append(ranges)
    if len(m.rate_at):
        J = np.zeros((len(m.rate_at), 3, by.size))
        J[:, :, by.turn_columns] = by.rate[m.rate_at]
        blocks.append(J.reshape(-1, by.size) / problem.sigma_rate)
        values.append(rates.reshape(-1))
    if len(m.attitude_at):
        blocks.append(_of_attitudes(problem, m, at, by).reshape(-1, by.size))
        values.append(attitude.reshape(-1))
    counts = (len(m.uv), len(m.range_at), len(m.rate_at), len(m.attitude_at))
    unit = np.repeat(np.arange(sum(counts)), np.repeat((2, 1, 3, 3), counts))
    return Linear(
        Residuals(tracks, ranges, rates, attitude),
        np.concatenate(blocks) if blocks else np.zeros((0, by.size)),
        point,
        np.concatenate(values) if values else np.zeros(0),
        unit,
    )


class Slopes:
    """Derivatives of rotation and rate (n, 3, columns) by the parameters, and the place of these columns, and of those
    of the path, among all parameters."""

    def __init__(self, problem: Problem, at: Predicted, environment: EnvironmentModel) -> None:
        state = at.state
        active, pm = state.model.active, state.model.flat(True)
        self.turn, self.rate = sensitivities(
            problem.times,
            at.trajectory,
            state.q0,
            state.w0,
            state.inertia,
            inertia_directions(state.inertia),
            active,
            pm,
            environment,
        )
        nm = len(pm)
        self.sensed_from = BODY_SIZE + nm
        self.size = self.sensed_from + len(state.model.flat(False))
        effects = slice(BODY_SIZE, self.sensed_from)
        self.turn_columns = np.r_[TURN, RATE, INERTIA, effects]
        self.path_columns = np.r_[PLACE, VELOCITY, effects]


def _of_tracks(
    problem: Problem, m: Measurements, at: Predicted, by: Slopes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (o, 2) of the pixels, and their derivatives by the shared parameters and by their point, over 1-sigma."""
    model = at.state.model
    pm, ps = model.flat(True), model.flat(False)
    slopes = pixel_jacobian(problem.cameras, m.seen, at.motion, body_points(at, m), model.sensed, ps)
    e, first_sensed = m.seen.epoch, by.sensed_from
    turn, path = slopes.turn @ by.turn[e], slopes.place @ at.dr[e]
    if slopes.rate is not None:
        turn += slopes.rate @ by.rate[e]
    if slopes.velocity is not None:
        path += slopes.velocity @ at.dv[e]
    # column by column of `turn_columns` and `path_columns` this takes several times as long
    J = np.empty((len(m.uv), 2, by.size))
    J[:, :, :6], J[:, :, 6:12], J[:, :, INERTIA] = turn[:, :, :6], path[:, :, :6], turn[:, :, 6:11]
    J[:, :, BODY_SIZE:first_sensed] = turn[:, :, 11:] + path[:, :, 6:]
    for effect, place, _ in model.active:
        if hasattr(effect, "shift"):
            for k, by_value in enumerate(derivatives(effect.shift, problem.times, pm[place])):
                J[:, :, BODY_SIZE + place.start + k] += np.einsum("oij,oj->oi", slopes.point, by_value[e])
    J[:, :, first_sensed:] = slopes.effect
    J /= m.sigma[:, None, None]
    return (m.uv - slopes.uv) / m.sigma[:, None], J, slopes.point / m.sigma[:, None, None]


def _of_ranges(problem: Problem, m: Measurements, at: Predicted, by: Slopes) -> np.ndarray:
    """(k, p) [m]."""
    sensed, ps = at.state.model.sensed, at.state.model.flat(False)
    J = np.zeros((len(m.range_at), by.size))
    r = at.motion.r[m.range_at]
    J[:, by.path_columns] = np.einsum("ni,nik->nk", r / np.linalg.norm(r, axis=1, keepdims=True), at.dr[m.range_at])
    for effect, place in sensed.hooks("range_offset"):
        for k in range(place.stop - place.start):
            moved = ps[place].astype(complex)
            moved[k] += 1e-30j
            J[:, by.sensed_from + place.start + k] = (
                np.imag(effect.range_offset(problem.times[m.range_at], moved)) / 1e-30
            )
    return J


def _of_attitudes(problem: Problem, m: Measurements, at: Predicted, by: Slopes) -> np.ndarray:
    """(k, 3, p) over 1-sigma."""
    sensed, ps = at.state.model.sensed, at.state.model.flat(False)
    J = np.zeros((len(m.attitude_at), 3, by.size))
    J[:, :, by.turn_columns] = by.turn[m.attitude_at]
    for effect, place in sensed.hooks("turn"):
        # the camera's own turn is small: a change of it turns the body the other way in cam0's axes
        whole = camera_turn(at.motion, sensed, ps) @ at.motion.R
        for k, by_value in enumerate(derivatives(effect.turn, problem.times, ps[place])):
            J[:, :, by.sensed_from + place.start + k] = -np.einsum("nji,nj->ni", whole, by_value)[m.attitude_at]
    return np.asarray(J / problem.sigma_attitude[m.attitude_at, None, None])
