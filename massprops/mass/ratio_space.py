"""Shape of an inertia, free of its size, as five numbers: where two inertias and their uncertainties are compared.

The logarithm of an inertia in a fixed frame P is L = P^T log(I) P. Its five numbers (L11 - L22, L22 - L33, L23, L13,
L12) do not change with the inertia's size. In its own principal frame the first two are k1 and k2 and the rest are
zero; a small turn by t about P's axes changes the rest by (k2 t1, (k1 + k2) t2, k1 t3). So two equal moments need no
exception: the axes between them are free, and count for nothing.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from massprops.geometry.vectors import skew

NORMAL_90 = 1.6448536269514722
"""Half width of a normal 90 % interval in sigmas."""
FLIPS = np.array([np.diag(s) for s in product((1.0, -1.0), repeat=3) if np.prod(s) > 0])
"""(4, 3, 3) turns that leave a principal frame principal and right-handed."""


def log_inertia(inertia: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(..., 3, 3) logarithm of inertias (..., 3, 3) in the frame whose axes are the columns of `axes` (3, 3)."""
    moments, principal_axes = np.linalg.eigh(inertia)
    moments = np.maximum(moments, 1e-12 * moments[..., -1:])
    turned = np.swapaxes(axes, -1, -2) @ principal_axes
    return np.einsum("...ik,...k,...jk->...ij", turned, np.log(moments), turned)


def log_components(inertia: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(..., 5) of inertias (..., 3, 3) in the frame whose axes are the columns of `axes` (3, 3)."""
    return _five(log_inertia(inertia, axes))


def _five(L: np.ndarray) -> np.ndarray:
    """The numbers (..., 5) of logarithms (..., 3, 3)."""
    return np.stack(
        [L[..., 0, 0] - L[..., 1, 1], L[..., 1, 1] - L[..., 2, 2], L[..., 1, 2], L[..., 0, 2], L[..., 0, 1]], axis=-1
    )


def inertia_of(k: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(3, 3) of trace 1 with ratios k (2,) and principal axes as columns (3, 3), moments ascending."""
    moments = np.exp([k[0] + k[1], k[1], 0.0])
    return axes @ np.diag(moments / moments.sum()) @ axes.T


def covariance(
    inertia: np.ndarray, k_covariance: np.ndarray, axes_covariance: np.ndarray | None, axes: np.ndarray
) -> np.ndarray:
    """(5, 5) of `log_components` from the covariances of k (2, 2) and of a small turn about body axes (3, 3) [rad^2].

    Without a covariance of the turn its part is zero; the caller then leaves the axes out.
    """
    k = log_components(inertia, np.linalg.eigh(inertia)[1])[:2]
    principal_axes = np.linalg.eigh(inertia)[1]
    # central differences in k; the turn's part is exact: dL = [t]L - L[t]
    h = 1e-5
    by_k = np.column_stack(
        [
            (
                log_components(inertia_of(k + d, principal_axes), axes)
                - log_components(inertia_of(k - d, principal_axes), axes)
            )
            / (2 * h)
            for d in h * np.eye(2)
        ]
    )
    out: np.ndarray = by_k @ k_covariance @ by_k.T
    if axes_covariance is not None:
        by_turn = turn_jacobian(inertia, axes)
        out = out + by_turn @ axes_covariance @ by_turn.T
    return out


def turn_jacobian(inertia: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(5, 3) derivative of `log_components` by a small turn of the body about body axes [rad]."""
    moments, principal_axes = np.linalg.eigh(inertia)
    L = principal_axes @ np.diag(np.log(moments)) @ principal_axes.T
    return _five(np.array([axes.T @ (cross @ L - L @ cross) @ axes for cross in skew(np.eye(3))])).T


def turn_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3,) shortest turn [rad], about the axes of `b`, from principal frame b to a (3, 3), modulo their symmetries."""
    from massprops.dynamics.quaternion import from_rotation_matrix, rotation_vector

    right = [m * np.array([1.0, 1.0, np.sign(np.linalg.det(m))]) for m in (a, b)]
    turns = rotation_vector(from_rotation_matrix(np.swapaxes(right[1], 0, 1) @ right[0] @ FLIPS))
    return turns[np.argmin(np.linalg.norm(turns, axis=1))]


def covariance_of_replicates(inertias: np.ndarray, inertia: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(5, 5) second moment of replicates (r, 3, 3) about the estimate, which need not lie in their middle."""
    apart = log_components(inertias, axes) - log_components(inertia, axes)
    return apart.T @ apart / len(apart)


def covariance_of_intervals(document: dict[str, Any], axes: np.ndarray) -> np.ndarray | None:
    """(5, 5) from `interval_90` of a `massprops.json`; None when it has none, or one without ends.

    k1 and k2 as stated, without correlation; the rest from the intervals of the tensor's elements, taken as
    independent.
    """
    interval = document.get("interval_90") or {}
    ratios = document["inertia_ratios"]
    if any(not interval.get(k) or None in interval[k] for k in ("k1", "k2")):
        return None
    out = np.diag([*(interval_sigma(interval[k], ratios[k]) ** 2 for k in ("k1", "k2")), 0.0, 0.0, 0.0])
    inertia = np.array(document["inertia"], float)
    if interval.get("inertia"):
        for i in range(3):
            for j in range(i, 3):
                sigma = interval_sigma(interval["inertia"][i][j], inertia[i, j])
                step = np.zeros((3, 3))
                step[i, j] = step[j, i] = 1e-6 * np.trace(inertia)
                change = (log_components(inertia + step, axes) - log_components(inertia - step, axes)) / (
                    2e-6 * np.trace(inertia)
                )
                out[2:, 2:] += np.outer(change[2:], change[2:]) * sigma**2
    elif interval.get("principal_moments"):
        # the moments' own spread stands in for that of the products
        relative = [
            interval_sigma(b, m) / m
            for b, m in zip(interval["principal_moments"], document["principal_moments"], strict=True)
        ]
        out[2:, 2:] = np.eye(3) * float(np.mean(relative)) ** 2
    return out


def interval_sigma(bounds: list[float], value: float) -> float:
    """1-sigma of a 90 % interval that need not be symmetric about its value: the mean square of both halves."""
    low, high = (abs(float(b) - value) for b in bounds)
    return float(np.sqrt(0.5 * (low * low + high * high)) / NORMAL_90)


def chi_square(difference: np.ndarray, covariance: np.ndarray) -> tuple[float, int]:
    """Squared difference (k,) in units of its covariance (k, k), and its degrees of freedom.

    Directions without variance, such as the turn about an axis of symmetry, are left out.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    good = values > 1e-14 * max(float(values[-1]), 1e-300)
    along = vectors[:, good].T @ difference
    return float(np.sum(along**2 / values[good])), int(good.sum())


def p_value(chi2: float, degrees: int) -> float:
    """Chance of a chi-square at least so large."""
    from scipy.special import gammaincc

    return float(gammaincc(0.5 * degrees, 0.5 * chi2)) if degrees else 1.0
