"""pesce2017's filter: the state, its error coordinates, and how one leads to the other. Leading axis: runs (B).

State: angular velocity W, attitude q, centre of mass r, features X and velocity U of the body-fixed point that is at
the chaser just now (v = U + W x r), all in inertial axes from the chaser; inertia parameters. The paper's state
(rho, rho_dot, omega, q, P, k1, k2) in other coordinates: in these an image and its velocity depend on X, U and W
alone and almost linearly, never on where the centre of mass is or how the body axes lie, as neither can be seen in
one epoch. A filter in the paper's coordinates gains false certainty there, because its linearisation moves.

Errors are additive, but for the attitude: q_true = q exp(theta), theta a small turn in body axes (multiplicative), or
the four components as in the paper (additive).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprops.campaigns.papers._pesce2017_inertia import PARAMETERS, within
from massprops.dynamics.quaternion import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalise,
    rotate,
    rotation_matrix,
    rotation_vector,
)
from massprops.geometry.vectors import skew

COLUMNS = ("rho_m", "rho_dot_m_s", "omega_deg_s", "theta_deg", "k1", "k2")
"""Errors that a run reports of itself: of place and velocity, angular velocity and attitude, and of the ratios."""


class Layout:
    """Where each part of an error vector is.

    Attributes:
        features: m; additive: the attitude's four components are added.
        w, u, r, theta, k, x: of W, U, r, the attitude, the inertia's parameters and X; points: of each feature.
        size: of the whole; free: the same with the attitude's error as a turn.
    """

    def __init__(self, features: int, additive: bool = False) -> None:
        self.features, self.additive = features, additive
        self.w, self.u, self.r = slice(0, 3), slice(3, 6), slice(6, 9)
        self.theta = slice(9, 13 if additive else 12)
        self.k = slice(self.theta.stop, self.theta.stop + PARAMETERS)
        self.size: int = self.k.stop + 3 * features
        self.x = slice(self.k.stop, self.size)
        self.points = [slice(i, i + 3) for i in range(self.k.stop, self.size, 3)]
        self.free = Layout(features) if additive else self


class State(NamedTuple):
    """B runs: W (B, 3) [rad/s], U (B, 3) [m/s], r (B, 3) [m], q (B, 4) body to inertial, k (B, 2), X (B, m, 3) [m]."""

    W: np.ndarray
    U: np.ndarray
    r: np.ndarray
    q: np.ndarray
    k: np.ndarray
    X: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        """(B, 3) of the centre of mass [m/s], inertial axes."""
        return self.U + cross(self.W, self.r)

    @property
    def body_features(self) -> np.ndarray:
        """(B, m, 3) features from the centre of mass in body axes [m]."""
        return rotate(conjugate(self.q)[:, None], self.X - self.r[:, None])

    def take(self, which: np.ndarray) -> State:
        """The runs `which` (mask or numbers)."""
        return State(*(part[which] for part in self))

    def put(self, which: np.ndarray, other: State) -> State:
        """A copy in which the runs `which` are those of `other`."""
        parts = State(*(part.copy() for part in self))
        for part, new in zip(parts, other, strict=True):
            part[which] = new
        return parts


def state_of(
    position: np.ndarray, velocity: np.ndarray, w: np.ndarray, q: np.ndarray, features: np.ndarray, k: np.ndarray
) -> State:
    """From centre of mass and its velocity (B, 3), body rates (B, 3), attitude (B, 4), body features (B, m, 3)."""
    W = rotate(q, w)
    return State(W, velocity - cross(W, position), position, q, k, position[:, None] + rotate(q[:, None], features))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b (..., 3), broadcast; several times quicker than numpy's on short arrays."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out = np.empty((*x.shape, 3), x.dtype)
    out[..., 0] = x
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def xi(q: np.ndarray) -> np.ndarray:
    """(..., 4, 3): d(q exp(theta))/d(theta) = xi(q) / 2; orthonormal columns."""
    out = np.empty((*q.shape, 3), q.dtype)
    w, x, y, z = (q[..., i] for i in range(4))
    for i, row in enumerate(((-x, -y, -z), (w, -z, y), (z, w, -x), (-y, x, w))):
        for j, part in enumerate(row):
            out[..., i, j] = part
    return out


def retract(layout: Layout, state: State, error: np.ndarray) -> State:
    """The state moved by an error (B, size)."""
    if layout.additive:
        q = normalise(state.q + error[:, layout.theta])
    else:
        q = normalise(multiply(state.q, from_rotation_vector(error[:, layout.theta])))
    return State(
        state.W + error[:, layout.w],
        state.U + error[:, layout.u],
        state.r + error[:, layout.r],
        q,
        within(state.k + error[:, layout.k]),
        state.X + error[:, layout.x].reshape(state.X.shape),
    )


def mirrored(state: State) -> State:
    """The state that looks nearly the same: depths about the features' middle and the turn across the sight reversed."""
    middle = state.X.mean(axis=1)
    sight = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    depth = np.sum((state.X - middle[:, None]) * sight[:, None], axis=-1, keepdims=True)
    along = np.sum(state.W * sight, axis=-1, keepdims=True) * sight
    W = 2 * along - state.W
    U = state.U + cross(state.W, middle) - cross(W, middle)
    return State(W, U, state.r, state.q, state.k, state.X - 2 * depth * sight[:, None])


def difference(layout: Layout, ahead: State, state: State) -> np.ndarray:
    """The error (B, size) that leads from `state` to `ahead`."""
    out = np.zeros((len(state.W), layout.size))
    out[:, layout.w] = ahead.W - state.W
    out[:, layout.u] = ahead.U - state.U
    out[:, layout.r] = ahead.r - state.r
    if layout.additive:
        same = np.sign(np.sum(ahead.q * state.q, axis=-1, keepdims=True))
        out[:, layout.theta] = same * ahead.q - state.q
    else:
        out[:, layout.theta] = rotation_vector(multiply(conjugate(state.q), ahead.q))
    out[:, layout.k] = ahead.k - state.k
    out[:, layout.x] = (ahead.X - state.X).reshape(len(state.W), -1)
    return out


def covariance_of(
    layout: Layout,
    state: State,
    position: np.ndarray,
    velocity: np.ndarray,
    rate: np.ndarray,
    attitude: np.ndarray,
    k: np.ndarray,
    features: np.ndarray,
) -> np.ndarray:
    """Error covariance (B, size, size) of independent beliefs in everyday coordinates.

    Args:
        position, velocity: covariances (..., 3, 3) of the centre of mass, inertial axes.
        rate: (..., 3, 3) of W, inertial axes; attitude: (..., 3, 3) of a small turn, body axes [rad^2].
        k: (..., 2, 2) of the inertia parameters.
        features: (..., m, 3, 3), each from the centre of mass in body axes [m^2].
    """
    free = layout.free
    noise = np.zeros((len(state.W), free.size, free.size))
    for part, block in ((free.w, rate), (free.u, velocity), (free.r, position), (free.theta, attitude), (free.k, k)):
        noise[:, part, part] = block
    for i, point in enumerate(free.points):
        noise[:, point, point] = features[..., i, :, :]
    # columns: everyday errors (W, v, r, theta, k, p); rows: this file's
    J = np.zeros_like(noise)
    J[:] = np.eye(free.size)
    J[:, free.u, free.w] = skew(state.r)
    J[:, free.u, free.r] = -skew(state.W)
    R = rotation_matrix(state.q)
    points = state.body_features
    for i, point in enumerate(free.points):
        J[:, point, free.r] = np.eye(3)
        J[:, point, free.theta] = -R @ skew(points[:, i])
        J[:, point, point] = R
    P = J @ noise @ np.swapaxes(J, -1, -2)
    return to_additive(layout, state.q, P) if layout.additive else P


def to_additive(layout: Layout, q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """A covariance with the attitude's turn as one with its four components; along q the mean of the others."""
    free = layout.free
    J = additive_columns(layout, q)
    out: np.ndarray = J @ P @ np.swapaxes(J, -1, -2)
    mean = np.trace(P[:, free.theta, free.theta], axis1=1, axis2=2) / 12.0
    out[:, layout.theta, layout.theta] += mean[:, None, None] * q[:, :, None] * q[:, None, :]
    return out


def additive_columns(layout: Layout, q: np.ndarray) -> np.ndarray:
    """(B, size, size - 1) from errors with a turn to errors with four components."""
    n = layout.size
    J = np.zeros((len(q), n, n - 1))
    J[:, np.arange(9), np.arange(9)] = 1.0
    J[:, np.arange(13, n), np.arange(12, n - 1)] = 1.0
    J[:, 9:13, 9:12] = 0.5 * xi(q)
    return J
