"""Angular acceleration from measured image velocities, for the Euler pseudo-measurement (pesce2017 eq 37).

The paper takes the target's angular acceleration from the simulation and adds noise, leaving "the proper numerical
differentiation algorithm" open. This is one: each epoch's rate from that epoch's images alone (no dynamics, so that no
inertia is assumed where it is to be found), then a straight line through the rates of a window. Windows do not overlap,
so no rate counts twice. Its noise is what the images allow: with pesce2017's 1e-5 and 25 s about 7e-6 rad/s^2, seven
times the acceleration itself in its cases A and B.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprops.geometry.vectors import skew
from massprops.sensing.pinhole import Pinhole


def rates_from_flow(
    points: np.ndarray,
    flow: np.ndarray,
    sigma: float,
    cameras: Sequence[Pinhole],
    frame: np.ndarray,
    spin: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The target's angular velocity (B, 3) and its covariance (B, 3, 3), inertial axes, from one epoch.

    Args:
        points: (B, m, 3) triangulated features, inertial axes from the chaser [m].
        flow: (B, c, m, 2) image velocities; sigma: 1-sigma of each.
        frame: (3, 3) cam0 axes into inertial axes; spin: (3,) their rate, inertial axes [rad/s].
    """
    B, m = points.shape[:2]
    rows, values = [], []
    for number, camera in enumerate(cameras):
        axes = camera.R @ frame.T
        Y = points @ axes.T - camera.R @ camera.t
        uv = Y[..., :2] / Y[..., 2:]
        g = (axes[:2] - uv[..., None] * axes[2]) / Y[..., 2, None, None] * camera.intrinsics[:2, None]
        # flow = g (U + W x X - spin x X), U and W unknown
        rows.append(np.concatenate([-g @ skew(points), g], axis=-1).reshape(B, 2 * m, 6))
        values.append((flow[:, number] + (g @ np.cross(spin, points)[..., None])[..., 0]).reshape(B, 2 * m))
    A, z = np.concatenate(rows, axis=1) / sigma, np.concatenate(values, axis=1) / sigma
    scale = np.sqrt(np.sum(A * A, axis=1))
    A = A / scale[:, None]
    covariance = np.linalg.pinv(np.swapaxes(A, 1, 2) @ A, hermitian=True)
    motion = (covariance @ (np.swapaxes(A, 1, 2) @ z[..., None]))[..., 0] / scale
    covariance = covariance / (scale[:, :, None] * scale[:, None, :])
    return motion[:, :3], covariance[:, :3, :3]


def slope(times: np.ndarray, rates: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean angular acceleration over a window and its 1-sigma, both (B, 3), axis by axis.

    The sigma holds the noise of the rates and, for a body at rate w, what acceleration may change over half a window:
    w^3 T / 2.

    Args:
        times: (n,) [s]; rates: (n, B, 3) [rad/s]; covariance: (n, B, 3, 3).
    """
    weight = 1.0 / np.maximum(np.einsum("nbii->nbi", covariance), 1e-300)
    total = weight.sum(axis=0)
    middle = np.einsum("nbi,n->bi", weight, times) / total
    lever = times[:, None, None] - middle
    moment = np.sum(weight * lever**2, axis=0)
    acceleration = np.sum(weight * lever * rates, axis=0) / moment
    speed = np.linalg.norm(np.sum(weight * rates, axis=0) / total, axis=-1, keepdims=True)
    bending = speed**3 * (times[-1] - times[0]) / 2
    return acceleration, np.sqrt(1.0 / moment + bending**2)
