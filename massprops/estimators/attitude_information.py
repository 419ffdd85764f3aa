"""Whether a motion can show the inertia at all: the information that attitudes along it would carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.rotation import Acting, trajectory
from massprops.dynamics.sensitivities import sensitivities
from massprops.dynamics.surroundings import Surroundings
from massprops.sequence.data import Environment

LARGEST_SIGMA_K = 0.25
"""1-sigma of k1 or k2 above which the data are said not to show it."""
LARGEST_SIGMA_AXES = 0.5
"""1-sigma [rad] of the turn of the principal axes above which they are undetermined."""


@dataclass(frozen=True)
class Shown:
    """What attitudes would tell. sigma_k (2,); sigma_axes (3,) [rad] about the principal axes; reason: '' if enough."""

    sigma_k: np.ndarray
    sigma_axes: np.ndarray
    reason: str


def ratio_directions(moments: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Changes (5, 3, 3) of the inertia with k1, k2 and small turns of the axes about themselves.

    Args:
        moments: (3,) ascending; axes: (3, 3) their columns, right-handed.
    """
    a, b, c = moments
    out = [np.diag([a, 0.0, 0.0]), np.diag([0.0, 0.0, -c])]
    for i in range(3):
        turn = np.zeros((3, 3))
        j, k = (i + 1) % 3, (i + 2) % 3
        turn[j, k] = turn[k, j] = moments[j] - moments[k]
        out.append(turn)
    return np.array([axes @ d @ axes.T for d in out])


def shown_by(times: np.ndarray, weight: np.ndarray, q0: np.ndarray, w0: np.ndarray, inertia: np.ndarray) -> Shown:
    """The Cramer-Rao limit of ratios and axes for torque-free motion seen through its attitude.

    Args:
        times: (n,) [s]; weight: (n,) one over the variance of the attitude at each [rad^-2], 0 where unseen.
        q0: (4,), w0: (3,) at the first time, body axes [rad/s]; inertia: (3, 3) in body axes.
    """
    inertia = 3.0 * inertia / np.trace(inertia)
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 1] = -axes[:, 1]
    nothing = Acting((), ())
    around = Surroundings(Environment())
    none = np.zeros(0)
    path = trajectory(times, q0, w0, inertia, nothing, none, around)
    turn, _ = sensitivities(times, path, q0, w0, inertia, ratio_directions(moments, axes), nothing, none, around)
    normal = np.einsum("n,nai,naj->ij", weight, turn, turn)
    # a weak prior of one radian on each keeps the unobservable ones finite
    prior = np.diag([0, 0, 0, 0, 0, 0, 1.0, 1.0, 1.0, 1.0, 1.0])
    scale = np.sqrt(np.diag(normal + prior))
    covariance = np.linalg.pinv((normal + prior) / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sigma_k, sigma_axes = sigma[6:8], sigma[8:11]
    reason = ""
    if sigma_k.max() > LARGEST_SIGMA_K:
        along = axes.T @ w0 / max(float(np.linalg.norm(w0)), 1e-300)
        most = float(np.degrees(np.arccos(min(1.0, float(np.abs(along).max())))))
        reason = (
            f"the motion does not show k1 and k2 (1-sigma {sigma_k[0]:.2g}, {sigma_k[1]:.2g}): "
            f"it spins within {most:.1f} deg of a principal axis or is too short"
        )
    elif sigma_axes.max() > LARGEST_SIGMA_AXES:
        reason = "the body is symmetric within what the motion shows: its principal axes are not determined"
    return Shown(sigma_k, sigma_axes, reason)
