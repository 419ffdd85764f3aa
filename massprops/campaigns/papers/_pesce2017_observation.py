"""pesce2017's filter: what the sensors should read for a state, and how that depends on the error. Leading axis: runs.

Every function gives predicted values (B, rows) and their derivatives by the error with a multiplicative attitude
(B, rows, n); `stack` joins channels and turns the derivatives into those of the layout.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprops.campaigns.papers._pesce2017_inertia import PARAMETERS, components
from massprops.campaigns.papers._pesce2017_state import Layout, State, cross, xi
from massprops.geometry.vectors import skew
from massprops.sensing.pinhole import Pinhole

NEAREST = 1e-3
"""Depth [m] under which a point counts as at the camera: keeps every prediction finite."""


def images(
    layout: Layout,
    state: State,
    cameras: Sequence[Pinhole],
    frame: np.ndarray,
    spin: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Image positions and velocities of every feature in every camera, and its disparities.

    u_dot = (vx - u vy) / y in the paper's axes, v the feature's velocity in the camera's (pesce2017 eq 24-27, mended:
    the whole velocity of the point, depth along the camera's third axis).

    Args:
        frame: (3, 3) cam0 axes into inertial axes; spin: (3,) their angular velocity, inertial axes [rad/s].

    Returns:
        values (B, 4 c m + m): u, v, u_dot, v_dot of each feature, camera by camera, then the disparities, u of the second
        camera less u of the first (eq 28); derivatives (B, rows, n).
    """
    free = layout.free
    B, m = state.X.shape[:2]
    cross_x = skew(state.X)
    velocity = state.U[:, None] + cross(state.W[:, None], state.X)
    values, slopes = [], []
    each = np.arange(m)[:, None]
    for camera in cameras:
        focal, rows = camera.intrinsics[:2], camera.R @ frame.T
        depth, uv, g = _seen_by(camera, rows, state.X)
        H = np.zeros((B, m, 4, free.size))
        value = np.empty((B, m, 4))
        value[..., :2] = uv * focal + camera.intrinsics[2:]
        by_point = np.empty((B, m, 4, 3))
        by_point[:, :, :2] = g
        seen = (velocity - cross(spin, state.X)) @ rows.T
        moving = (seen[..., :2] - uv * seen[..., 2:]) / depth * focal
        value[..., 2:] = moving
        H[:, :, 2:, free.u] = g
        H[:, :, 2:, free.w] = -g @ cross_x
        turning = g @ skew(state.W - spin)[:, None]
        by_point[:, :, 2:] = (
            turning - g * (seen[..., 2:] / depth)[..., None] - moving[..., None] * rows[2] / depth[..., None]
        )
        H[:, each, :, free.x.start + 3 * each + np.arange(3)] = np.moveaxis(by_point, (1, 3), (0, 1))
        values.append(value)
        slopes.append(H)
    out = [*(a.reshape(B, 4 * m) for a in values), values[1][..., 0] - values[0][..., 0]]
    outH = [*(a.reshape(B, 4 * m, free.size) for a in slopes), slopes[1][:, :, 0] - slopes[0][:, :, 0]]
    return np.concatenate(out, axis=1), np.concatenate(outH, axis=1)


def _seen_by(camera: Pinhole, rows: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, ...]:
    """Depth (B, m, 1) of points X (B, m, 3), normalised image (B, m, 2), and
    d(u, v)/dX, which is d(u_dot, v_dot)/dV too (B, m, 2, 3). rows: (3, 3) inertial axes into the camera's."""
    Y = X @ rows.T - camera.R @ camera.t
    depth = np.maximum(Y[..., 2], NEAREST)[..., None]
    uv = Y[..., :2] / depth
    return depth, uv, (rows[:2] - uv[..., None] * rows[2]) / depth[..., None] * camera.intrinsics[:2, None]


def euler_constraint(layout: Layout, state: State, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residual (B, 3) of the pseudo-measurement 0 = w_dot + I^-1 (w x I w) (pesce2017 eq 37), inertial axes.

    Args:
        acceleration: (B, 3) of the target, inertial axes [rad/s^2], from a differentiator of rates.
    """
    from massprops.dynamics.kernels import euler_acceleration, to_body, to_reference

    free = layout.free
    step = 1e-150
    columns = np.r_[free.w, free.theta, free.k]
    W = np.repeat(state.W[:, :, None].astype(complex), len(columns), axis=2)
    q = np.repeat(state.q[:, :, None].astype(complex), len(columns), axis=2)
    k = np.repeat(state.k[:, :, None].astype(complex), len(columns), axis=2)
    for i in range(3):
        W[:, i, i] += 1j * step
    q[:, :, 3:6] += 0.5j * step * xi(state.q)
    for i in range(PARAMETERS):
        k[:, i, 6 + i] += 1j * step
    w = to_body(*(q[:, i] for i in range(4)), *(W[:, i] for i in range(3)))
    rate = euler_acceleration(tuple(components(np.moveaxis(k, 1, -1))), (w[0], w[1], w[2]), (0.0, 0.0, 0.0))
    there = np.stack(to_reference(q[:, 0], q[:, 1], q[:, 2], q[:, 3], *rate), axis=1)
    H = np.zeros((len(state.W), 3, free.size))
    H[:, :, columns] = there.imag / step
    return acceleration - there[:, :, 0].real, H


def for_layout(layout: Layout, state: State, H: np.ndarray) -> np.ndarray:
    """Derivatives by the layout's error: as they are, or by the attitude's four components (paper, additive)."""
    if not layout.additive:
        return H
    return np.concatenate([H[..., :9], 2.0 * H[..., 9:12] @ np.swapaxes(xi(state.q), -1, -2), H[..., 12:]], axis=-1)
