"""Whether a motion can show the inertia at all: the information that attitudes along it would carry."""

from __future__ import annotations

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import DIRECTIONS, principal_axes, ratio_derivatives
from massprops.dynamics.rotation import ActiveEffects, trajectory
from massprops.dynamics.sensitivities import sensitivities
from massprops.sequence.data import Environment

LARGEST_SIGMA_K = 0.25
"""1-sigma of k1 or k2 above which the data are said not to show it."""
LARGEST_SIGMA_AXES = 0.5
"""1-sigma [rad] of the turn of the principal axes above which they are undetermined."""


def shown_by(
    times: np.ndarray, weight: np.ndarray, q0: np.ndarray, w0: np.ndarray, inertia: np.ndarray
) -> tuple[np.ndarray, str]:
    """The Cramer-Rao limit of k1, k2 (2,) for torque-free motion seen through its attitude, and why that, or that of the axes,
    is too wide; '' where it is not.

    Args:
        times: (n,) [s]; weight: (n,) one over the variance of the attitude at each [rad^-2], 0 where unseen.
        q0: (4,), w0: (3,) at the first time, body axes [rad/s]; inertia: (3, 3) in body axes.
    """
    inertia = 3.0 * inertia / np.trace(inertia)
    nothing = ActiveEffects((), ())
    environment = EnvironmentModel(Environment())
    none = np.zeros(0)
    path = trajectory(times, q0, w0, inertia, nothing, none, environment)
    turn, _ = sensitivities(times, path, q0, w0, inertia, DIRECTIONS, nothing, none, environment)
    normal = np.einsum("n,nai,naj->ij", weight, turn, turn)
    # a weak prior on the shape keeps what is unobservable finite
    covariance = inverse_of(normal + np.diag([0.0] * 6 + [1.0] * 5))[6:, 6:]
    moments, axes = principal_axes(inertia)
    spread = [np.einsum("ai,ij,aj->a", J, covariance, J) for J in ratio_derivatives(moments, axes, DIRECTIONS)]
    sigma_k, sigma_axes = (np.sqrt(np.maximum(square, 0.0)) for square in spread)
    return sigma_k, hidden_by(sigma_k, float(sigma_axes.max()), w0, axes)


def hidden_by(
    sigma_k: np.ndarray, sigma_axes: float, w0: np.ndarray, axes: np.ndarray, largest: float = LARGEST_SIGMA_K
) -> str:
    """One line when the data do not show ratios or axes; empty when they do.

    Args:
        sigma_k: (2,); sigma_axes: the largest [rad]; w0: (3,) body rates; axes: (3, 3) principal ones as columns;
        largest: of sigma_k.
    """
    if not (np.isfinite(sigma_k).all() and sigma_k.max() <= largest):
        along = np.abs(axes.T @ w0) / max(float(np.linalg.norm(w0)), 1e-300)
        off = float(np.degrees(np.arccos(min(1.0, float(along.max())))))
        return (
            f"the motion does not show k1 and k2 (1-sigma {sigma_k[0]:.2g}, {sigma_k[1]:.2g}): "
            f"it spins within {off:.1f} deg of a principal axis or is too short"
        )
    if sigma_axes > LARGEST_SIGMA_AXES:
        return "the body is symmetric within what the motion shows: its principal axes are not determined"
    return ""
