"""What an image's second order adds to a prediction's uncertainty: for the EKF, which does not iterate.

A feature that is believed to 1 m at 60 m is off its linear prediction by 3e-4 in the image, thirty times pesce2017's
noise. A plain EKF takes that for information and never recovers; the second-order EKF (Maybeck 1982, ch. 12) corrects
the mean and adds the term's variance to the measurement's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprops.campaigns.papers._pesce2017_inertia import PARAMETERS
from massprops.campaigns.papers._pesce2017_observation import NEAREST
from massprops.campaigns.papers._pesce2017_state import Layout, State, cross
from massprops.geometry.vectors import skew
from massprops.sensing.pinhole import Pinhole

LEVI_CIVITA = np.array(
    [[[0, 0, 0], [0, 0, 1], [0, -1, 0]], [[0, 0, -1], [0, 0, 0], [1, 0, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]], float
)

BENDING = 0.1
"""Second order over noise from which it counts."""

SHARED = 2.0
"""Two cameras, and a position and its velocity, share the same second-order error; it counts once for each."""


def cross_covariance(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Covariance (..., 3, 3) of a x b for zero-mean normal a and b (Isserlis).

    Args:
        A, B: covariances (..., 3, 3) of a and b; C: (..., 3, 3) of a with b.
    """
    D = np.swapaxes(C, -1, -2)
    pairs = A[..., :, None, :, None] * B[..., None, :, None, :] + C[..., :, None, None, :] * D[..., None, :, :, None]
    flat = LEVI_CIVITA.reshape(3, 9)
    spread = flat @ pairs.reshape(*A.shape[:-2], 9, 9) @ flat.T
    return np.asarray(0.5 * (spread + np.swapaxes(spread, -1, -2)))


def image_curvature(
    layout: Layout,
    state: State,
    P: np.ndarray,
    cameras: Sequence[Pinhole],
    frame: np.ndarray,
    spin: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance (B, rows) of the second order of `observation.images`, rows in the same order.

    Args:
        P: (B, n, n) covariance of the prediction; the rest as in `images`.
    """
    x = np.r_[0:9, layout.k.start : layout.size]
    P = P[:, x[:, None], x]
    B, m = state.X.shape[:2]
    start = 9 + PARAMETERS
    each = start + 3 * np.arange(m)[:, None] + np.arange(3)
    of_points = P[:, each[:, :, None], each[:, None, :]]
    joint, velocity, turning = _moving(state, P, each, of_points, spin)
    means, spreads, depths = [], [], []
    for camera in cameras:
        rows = camera.R @ frame.T
        both = np.kron(np.eye(2), rows)
        S = both @ joint @ both.T
        Y = state.X @ rows.T - camera.R @ camera.t
        C = np.maximum(Y[..., 2], NEAREST)
        mean, spread = np.zeros((2, B, m, 4))
        for axis in (0, 1):
            A, focal = Y[..., axis], camera.intrinsics[axis]
            H = np.zeros((B, m, 2, 2))
            H[..., 0, 1], H[..., 1, 1] = -1 / C**2, 2 * A / C**3
            mean[..., axis], spread[..., axis] = _moments(H, S[..., [[axis], [2]], [axis, 2]], focal)
            V = velocity @ rows.T
            pick = np.array([axis, 2, 3 + axis, 5])
            H = _flow_bend(A, C, V[..., axis], V[..., 2])
            mean[..., 2 + axis], spread[..., 2 + axis] = _moments(H, S[..., pick[:, None], pick], focal)
            g = (rows[axis] - (A / C)[..., None] * rows[2]) / C[..., None] * focal
            spread[..., 2 + axis] += np.einsum("...i,...ij,...j->...", g, turning, g)
        means.append(mean.reshape(B, -1))
        spreads.append(spread.reshape(B, -1))
        depths.append((C, S[..., 2, 2], camera))
    # u1 - u0 = -(fu b)/C: second derivative -2 fu b / C^3
    C, var, camera = depths[0]
    base = (camera.R @ (depths[1][2].t - camera.t))[0] * camera.intrinsics[0]
    curvature = -2 * base / C**3
    means.append(0.5 * curvature * var)
    spreads.append(0.5 * (curvature * var) ** 2)
    return np.concatenate(means, axis=1), SHARED * np.concatenate(spreads, axis=1)


def _flow_bend(A: np.ndarray, C: np.ndarray, Va: np.ndarray, Vc: np.ndarray) -> np.ndarray:
    """Second derivatives (..., 4, 4), upper triangle, of d(A / C)/dt by A, C and their rates Va, Vc."""
    H = np.zeros((*A.shape, 4, 4))
    H[..., 0, 1], H[..., 0, 3], H[..., 1, 2] = 2 * Vc / C**3, -1 / C**2, -1 / C**2
    H[..., 1, 3], H[..., 1, 1] = 2 * A / C**3, 2 * Va / C**3 - 6 * A * Vc / C**4
    return H


def _moving(
    state: State, P: np.ndarray, each: np.ndarray, of_points: np.ndarray, spin: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance (B, m, 6, 6) of the points and their velocities, inertial axes; the velocities (B, m, 3); covariance
    (B, m, 3, 3) of the error of the rate times that of the place."""
    B, m = state.X.shape[:2]
    # the point and its velocity in inertial axes by (W, U, r, k, X)
    J = np.zeros((B, m, 6, P.shape[-1]))
    for i in range(m):
        J[:, i, :3, each[i, 0] : each[i, 2] + 1] = np.eye(3)
        J[:, i, 3:, each[i, 0] : each[i, 2] + 1] = skew(state.W - spin)
    J[:, :, 3:, 0:3] = -skew(state.X)
    J[:, :, 3:, 3:6] = np.eye(3)
    joint = J @ P[:, None] @ np.swapaxes(J, -1, -2)
    with_w = np.moveaxis(P[:, 0:3][:, :, each], 1, 2)
    turning = cross_covariance(np.broadcast_to(P[:, None, 0:3, 0:3], of_points.shape), of_points, with_w)
    return joint, state.U[:, None] + cross(state.W[:, None] - spin, state.X), turning


def bends(layout: Layout, state: State, P: np.ndarray, sigma_flow: float) -> np.ndarray:
    """(B,) True where uncertain rates times uncertain places are a tenth of the image velocity's noise or more."""
    rate = np.sqrt(np.trace(P[:, layout.w, layout.w], axis1=1, axis2=2))
    places = np.diagonal(P, axis1=1, axis2=2)[:, layout.x]
    place = np.sqrt(places.reshape(*state.X.shape[:2], 3).sum(axis=-1).max(axis=-1))
    return np.asarray(rate * place > BENDING * sigma_flow * np.linalg.norm(state.X, axis=-1).min(axis=-1))


def constraint_curvature(layout: Layout, state: State, P: np.ndarray) -> np.ndarray:
    """Variance (B, 1) that the second order of `observation.euler_constraint` may have [rad^2/s^4].

    w_dot is a product of two rates and of a number between -1 and 1 that stands for the inertia; with rates known to
    1 deg/s and an acceleration to 1e-6 rad/s^2 its straight line means nothing, and the filter would settle anywhere.
    """
    sigma = np.sqrt(np.trace(P[:, layout.w, layout.w], axis1=1, axis2=2))
    speed = np.linalg.norm(state.W, axis=-1)
    return np.asarray(((2.0 * speed * sigma + sigma**2) ** 2)[:, None])


def _moments(H: np.ndarray, S: np.ndarray, focal: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean tr(H S)/2 and variance tr(H S H S)/2 of a quadratic form; H upper triangle given."""
    H = H + np.swapaxes(H, -1, -2) * (1 - np.eye(H.shape[-1]))
    HS = H @ S
    mean = 0.5 * np.trace(HS, axis1=-2, axis2=-1)
    return focal * mean, 0.5 * focal**2 * np.einsum("...ij,...ji->...", HS, HS)
