"""What the batch fit moves: initial state, inertia, effects, feature points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.core.linalg import consecutive
from massprops.dynamics.inertia import DIRECTIONS, principal_axes, ratio_derivatives, ratios_of_moments
from massprops.dynamics.quaternion import (
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
)
from massprops.dynamics.rotation import six_of
from massprops.model import Model

TURN, RATE, PLACE, VELOCITY, INERTIA = consecutive((3, 3, 3, 3, 5))
"""Where a step of the state has what: a turn and a rate in body axes, place and velocity, the inertia's five parameters."""
BODY_SIZE = INERTIA.stop
"""Numbers of a step before the parameters of the effects, which follow: those of the motion, then those of the sensors."""


@dataclass(frozen=True)
class BatchState:
    """One point of the search; m features.

    Attributes:
        q0: (4,) body to inertial (cam0 at the first epoch); w0: (3,) body axes [rad/s].
        r0, v0: (3,) centre of mass, inertial axes [m, m/s].
        inertia: (3, 3) body axes, mean moment 1 (trace 3).
        model: effects and their parameters.
        points: (m, 3) features from the centre of mass, body axes [m]; NaN for those not placed.
    """

    q0: np.ndarray
    w0: np.ndarray
    r0: np.ndarray
    v0: np.ndarray
    inertia: np.ndarray
    model: Model
    points: np.ndarray

    @property
    def size(self) -> int:
        """Parameters besides the feature points: the body's and those of the effects."""
        return BODY_SIZE + sum(len(v) for v in self.model.values)

    @property
    def motion_count(self) -> int:
        return len(self.model.flat(True))


LEAST = 1e-4
"""Smallest part of a second moment over the largest: a plate this thin, or a rod, is still a body."""


def in_axes(state: BatchState, T: np.ndarray) -> BatchState:
    """The same motion in other body axes; T (3, 3) turns components in the old ones into those in the new.

    Parameters of effects in body axes are left as they are.
    """
    return replace(
        state,
        q0=multiply(state.q0, from_rotation_matrix(T.T)),
        w0=T @ state.w0,
        inertia=T @ state.inertia @ T.T,
        points=state.points @ T.T,
    )


def second_moment(inertia: np.ndarray) -> np.ndarray:
    """Sigma = tr(I)/2 - I (3, 3): positive definite exactly when I is the inertia of a solid body."""
    return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia)


def inertia_of(sigma: np.ndarray) -> np.ndarray:
    """The inertia (3, 3) of a second moment (3, 3), scaled to a mean moment of 1."""
    inertia = np.trace(sigma) * np.eye(3) - sigma
    return np.asarray(3.0 * inertia / np.trace(inertia))


def inertia_directions(inertia: np.ndarray) -> np.ndarray:
    """(5, 3, 3) changes of the inertia by the local parameters of `moved_inertia` at zero."""
    root = _root(second_moment(inertia))
    out = []
    for basis in DIRECTIONS:
        change = root @ basis @ root
        raw = np.trace(change) * np.eye(3) - change
        # at mean moment 1 tr(Sigma) is 1.5 and tr(I) is 3: the scaling back to trace 3
        out.append(raw - inertia * np.trace(raw) / 3.0)
    return np.array(out)


def log_shape(inertia: np.ndarray) -> np.ndarray:
    """(5,) logarithm of the second moment without its size, along `DIRECTIONS`: zero for a ball."""
    values, vectors = np.linalg.eigh(second_moment(inertia))
    return np.asarray(np.einsum("kij,ij->k", DIRECTIONS, (vectors * np.log(np.maximum(values, LEAST))) @ vectors.T))


def moved_inertia(inertia: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Sigma^1/2 exp(sum d_k B_k) Sigma^1/2 as an inertia: physical for every d (5,)."""
    values, vectors = np.linalg.eigh(np.tensordot(d, DIRECTIONS, 1))
    root = _root(second_moment(inertia))
    sigma, axes = np.linalg.eigh(root @ (vectors * np.exp(np.clip(values, -5, 5))) @ vectors.T @ root)
    return inertia_of((axes * np.maximum(sigma, LEAST * sigma[-1])) @ axes.T)


def moved(state: BatchState, d: np.ndarray, points: np.ndarray) -> BatchState:
    """The state after a step d (size,) and new points.

    The step is what it is to first order; beyond, the body axes turn with their content: a turn of them against the body,
    which only a prior of the inertia prevents, is then straight however far it goes.
    """
    turn, sensed_from = d[TURN], BODY_SIZE + state.motion_count
    back, inertia = rotation_matrix(from_rotation_vector(-turn)), state.inertia
    if np.any(d[INERTIA]):
        inertia = back @ moved_inertia(inertia, d[INERTIA] - _turning(inertia, turn)) @ back.T
    return replace(
        state,
        q0=normalise(multiply(state.q0, from_rotation_vector(turn))),
        w0=back @ (state.w0 + d[RATE] + np.cross(turn, state.w0)),
        r0=state.r0 + d[PLACE],
        v0=state.v0 + d[VELOCITY],
        inertia=inertia,
        model=state.model.moved(d[BODY_SIZE:sensed_from], d[sensed_from:]),
        points=(points + np.cross(turn, state.points)) @ back.T,
    )


def _turning(inertia: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(5,) local parameters by which the inertia changes to first order when the body axes make a small turn."""
    K = np.cross(np.eye(3), turn)
    directions = np.array([six_of(one) for one in inertia_directions(inertia)])
    return np.asarray(np.linalg.lstsq(directions.T, np.array(six_of(inertia @ K - K @ inertia)), rcond=None)[0])


def ratio_jacobian(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """k (2,), axes (3, 3), and their derivatives by the five local parameters: (2, 5), and (3, 5) as a small turn in
    body axes."""
    moments, axes = principal_axes(inertia)
    by_k, by_turn = ratio_derivatives(moments, axes, inertia_directions(inertia))
    return ratios_of_moments(moments), axes, by_k, axes @ by_turn


def _root(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 1e-12))) @ vectors.T)
