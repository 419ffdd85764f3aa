"""The algebra of inertia tensors that all estimators share: ways to change, ratios and principal axes, possible bodies.

Only ratios of moments show in free motion, so a tensor is given up to scale; `trace` says which scale a function gives.
"""

from __future__ import annotations

import numpy as np

LEAST_PART = 1e-4
"""Smallest eigenvalue of Sigma = tr(I)/2 - I over its trace, of a body that is looked for."""
SMALLEST_GAP = 1e-9
"""Gap between two moments, over their sum, below which their axes turn as they would at this gap: without end, but finite."""


def _directions() -> np.ndarray:
    r = np.sqrt(0.5)
    E = np.zeros((5, 3, 3))
    E[0] = np.diag([r, -r, 0])
    E[1] = np.diag([1, 1, -2]) / np.sqrt(6)
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        E[2 + k, i, j] = E[2 + k, j, i] = r
    return E


DIRECTIONS = _directions()
"""(5, 3, 3) orthonormal symmetric matrices without trace: the ways an inertia of fixed trace can change."""


def ratio_derivatives(moments: np.ndarray, axes: np.ndarray, changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of k1 = ln(I1/I2), k2 = ln(I2/I3) (..., 2, p), and of a small turn of the principal axes about
    themselves (..., 3, p) [rad], by p changes of the inertia.

    First-order perturbation: with axes V and moments d, d(ln d_i) = (V^T dI V)_ii / d_i, and the turn about axis k is
    (V^T dI V)_ij / (d_i - d_j) for (i, j, k) in order.

    Args:
        moments: (..., 3) in any order; axes: (..., 3, 3) their columns, right-handed; changes: (..., p, 3, 3), body axes.
    """
    along_axes = np.einsum("...ai,...pab,...bj->...pij", axes, changes, axes, optimize=True)
    log = np.einsum("...pii->...ip", along_axes) / moments[..., None]
    turns = []
    for i, j in ((1, 2), (2, 0), (0, 1)):
        gap = moments[..., i] - moments[..., j]
        gap = np.copysign(np.maximum(np.abs(gap), SMALLEST_GAP * np.sum(moments, axis=-1)), gap)
        turns.append(along_axes[..., i, j] / gap[..., None])
    return np.stack([log[..., 0, :] - log[..., 1, :], log[..., 1, :] - log[..., 2, :]], axis=-2), np.stack(
        turns, axis=-2
    )


def principal_axes(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments ascending (..., 3) and their axes (..., 3, 3) as columns, right-handed."""
    moments, axes = np.linalg.eigh(inertia)
    axes[..., 2] *= np.sign(np.linalg.det(axes))[..., None]
    return moments, axes


def ratios_of_moments(moments: np.ndarray) -> np.ndarray:
    """ln(I1/I2), ln(I2/I3) as (..., 2), of moments (..., 3) in their order."""
    log = np.log(moments)
    return np.asarray(log[..., :2] - log[..., 1:])


def ratios(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k1 = ln(I1/I2) and k2 = ln(I2/I3) (..., 2), moments ascending, and their axes (..., 3, 3) as columns, right-handed."""
    moments, axes = principal_axes(inertia)
    return ratios_of_moments(moments), axes


def is_physical(moments: np.ndarray, slack: float = 1e-12) -> bool:
    """Whether a distribution of positive mass can have these moments (3,): positive, and the triangle inequality.

    Args:
        slack: share of the largest by which the other two may fall short of it.
    """
    low, middle, high = np.sort(np.asarray(moments, float))
    return bool(low > 0 and low + middle >= high * (1 - slack))


def project_to_physical(inertia: np.ndarray, least: float = LEAST_PART) -> np.ndarray:
    """The nearest inertia (3, 3) of trace 1 to a matrix (3, 3), with positive moments that meet the triangle inequalities.

    Those hold together exactly when Sigma = tr(I)/2 - I, the second moments of mass, is positive definite.
    """
    inertia = 0.5 * (inertia + inertia.T)
    # by a power of two, which is exact: in the norm squares of tiny numbers would be nought
    inertia = np.ldexp(inertia, -np.frexp(np.abs(inertia).max())[1])
    trace = float(np.trace(inertia)) / 2
    if not trace > 1e-6 * np.linalg.norm(inertia):
        return np.eye(3) / 3.0
    values, axes = np.linalg.eigh(trace * np.eye(3) - inertia)
    sigma = axes @ np.diag(_simplex(values / trace, least)) @ axes.T
    sigma = sigma / np.trace(sigma) / 2.0
    return np.asarray(np.trace(sigma) * np.eye(3) - sigma)


def _simplex(values: np.ndarray, least: float) -> np.ndarray:
    """Nearest values that are at least `least` and sum to one."""
    room = 1.0 - 3 * least
    v = np.sort(values - least)[::-1]
    total = np.cumsum(v) - room
    k = np.flatnonzero(v - total / np.arange(1, 4) > 0)[-1]
    return np.asarray(np.maximum(values - least - total[k] / (k + 1), 0.0) + least)


def cholesky_inertia(parameters: np.ndarray) -> np.ndarray:
    """(..., 3, 3) of trace 1, of the five numbers a, b, c1, c2, c3 (..., 5).

    I = L diag(e^a, 1, e^-b) L^T with L unit lower triangular of c1, c2, c3: positive definite for every value, in any body
    axes, and smooth where moments coincide.
    """
    a, b, c1, c2, c3 = (np.asarray(parameters)[..., i] for i in range(5))
    d1, d3 = np.exp(a), np.exp(-b)
    xy, xz, yz = c1 * d1, c2 * d1, c1 * c2 * d1 + c3
    yy, zz = c1 * xy + 1.0, c2 * xz + c3 * c3 + d3
    rows = [[d1, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return np.asarray(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2) / (d1 + yy + zz)[..., None, None])


def cholesky_parameters(tensor: np.ndarray) -> np.ndarray:
    """The five numbers (..., 5) of `cholesky_inertia`, of positive definite inertias (..., 3, 3)."""
    L = np.linalg.cholesky(tensor)
    d = np.diagonal(L, axis1=-2, axis2=-1)
    unit, log = L / d[..., None, :], 2 * np.log(d)
    below = (unit[..., 1, 0], unit[..., 2, 0], unit[..., 2, 1])
    return np.stack([log[..., 0] - log[..., 1], log[..., 1] - log[..., 2], *below], axis=-1)


def cholesky_changes(parameters: np.ndarray) -> np.ndarray:
    """Derivatives (..., 5, 3, 3) of `cholesky_inertia` by the five numbers (..., 5)."""
    step, at = 1e-6 * np.eye(5), np.asarray(parameters, float)[..., None, :]
    return np.asarray((cholesky_inertia(at + step) - cholesky_inertia(at - step)) / 2e-6)


def cholesky_ratio_derivatives(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`ratio_derivatives`, moments ascending, by the five numbers (..., 5): (..., 2, 5) and (..., 3, 5)."""
    return ratio_derivatives(*principal_axes(cholesky_inertia(parameters)), cholesky_changes(parameters))
