"""Inertia up to scale as the unconstrained parameters a filter can add to.

`principal` (2 parameters): the body frame is the principal frame. Euler's equations are w1_dot = a1 w2 w3 and so on
with a1 = (I2 - I3)/I1, ...; bodies of positive mass have |a| < 1, and a = tanh(eta) gives eta1 + eta2 + eta3 = 0.
The motion is nearly linear in eta, which k1, k2 are not, and every eta is a possible body (the triangle inequality).

`general` (5 parameters): any body frame. I = L diag(e^a, 1, e^-b) L^T with L unit lower triangular (c1, c2, c3):
positive definite for every value, and smooth where moments coincide.

All functions are component-wise on the last axis, for real and complex arrays.
"""

from __future__ import annotations

import numpy as np

PRINCIPAL, GENERAL = 2, 5
"""How many parameters each form has; the form is told by that number."""

LARGEST_ETA = 3.0
"""|a| = 0.995: no farther, or the motion would hardly depend on the parameter any more."""

LARGEST_GENERAL = 5.0
"""A ratio of moments of 150: more slender than any spacecraft."""


def within(parameters: np.ndarray) -> np.ndarray:
    """The parameters, kept where the motion still depends on them."""
    largest = LARGEST_ETA if parameters.shape[-1] == PRINCIPAL else LARGEST_GENERAL
    return np.clip(parameters, -largest, largest)


def components(parameters: np.ndarray) -> tuple[np.ndarray, ...]:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz, each (...), of parameters (..., 2) or (..., 5)."""
    if parameters.shape[-1] == PRINCIPAL:
        a1, a2 = np.tanh(parameters[..., 0]), np.tanh(parameters[..., 1])
        zero = np.zeros_like(a1)
        return (1 - a2) / (1 + a1), zero + 1.0, (1 + a1 * a2) / (1 + a1), zero, zero, zero
    a, b, c1, c2, c3 = (parameters[..., i] for i in range(GENERAL))
    d1, d3 = np.exp(a), np.exp(-b)
    return (
        d1,
        c1 * c1 * d1 + 1.0,
        c2 * c2 * d1 + c3 * c3 + d3,
        c1 * d1,
        c2 * d1,
        c1 * c2 * d1 + c3,
    )


def inertia(parameters: np.ndarray) -> np.ndarray:
    """(..., 3, 3) inertia with trace 1, of parameters (..., 2) or (..., 5)."""
    xx, yy, zz, xy, xz, yz = components(parameters)
    rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    whole = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return whole / (xx + yy + zz)[..., None, None]


def from_inertia(tensor: np.ndarray) -> np.ndarray:
    """The five `general` parameters (..., 5) of positive definite inertias (..., 3, 3)."""
    L = np.linalg.cholesky(tensor)
    d = np.diagonal(L, axis1=-2, axis2=-1)
    unit = L / d[..., None, :]
    log = 2 * np.log(d)
    return np.stack(
        [log[..., 0] - log[..., 1], log[..., 1] - log[..., 2], unit[..., 1, 0], unit[..., 2, 0], unit[..., 2, 1]],
        axis=-1,
    )


def ratios_of(eta: np.ndarray) -> np.ndarray:
    """k1 = ln(Ix/Iy), k2 = ln(Iy/Iz) (..., 2) of `principal` parameters (..., 2), axes in their own order."""
    xx, yy, zz, *_ = components(eta)
    return np.stack([np.log(xx / yy), np.log(yy / zz)], axis=-1)


def from_ratios(k: np.ndarray) -> np.ndarray:
    """`principal` parameters (..., 2) of k1, k2 (..., 2); an impossible body becomes the nearest possible in each."""
    x, z = np.exp(k[..., 0]), np.exp(-k[..., 1])
    largest = np.tanh(LARGEST_ETA)
    a1 = np.clip((1.0 - z) / x, -largest, largest)
    a2 = np.clip(z - x, -largest, largest)
    return np.arctanh(np.stack([a1, a2], axis=-1))


def principal_prior(k: np.ndarray, sigma: np.ndarray, points: int = 61) -> tuple[np.ndarray, np.ndarray]:
    """Mean (B, 2) and covariance (B, 2, 2) of eta when k1, k2 are believed normal about k (B, 2) with `sigma` (2,).

    Only possible bodies count (|a1|, |a2|, |a3| < 1): moments of what is left of the normal distribution over a grid.
    A belief that no possible body comes near becomes the nearest possible body, as uncertain as in eta it can be.
    """
    line = np.linspace(-4.0, 4.0, points)
    g1, g2 = np.meshgrid(line, line, indexing="ij")
    means, covariances = [], []
    for centre in np.atleast_2d(k):
        grid = np.stack([centre[0] + sigma[0] * g1.ravel(), centre[1] + sigma[1] * g2.ravel()], axis=-1)
        eta = from_ratios(grid)
        possible = (np.abs(ratios_of(eta) - grid).max(axis=-1) < 1e-6) & (np.abs(eta.sum(axis=-1)) < LARGEST_ETA)
        weight = np.where(possible, np.exp(-0.5 * (g1.ravel() ** 2 + g2.ravel() ** 2)), 0.0)
        if weight.sum() < 1e-6:
            means.append(np.clip(from_ratios(centre), -2.0, 2.0))
            covariances.append(np.eye(2))
            continue
        weight = weight / weight.sum()
        mean = weight @ eta
        off = eta - mean
        means.append(mean)
        covariances.append((off * weight[:, None]).T @ off)
    return np.stack(means), np.stack(covariances)


def ratios_jacobian(eta: np.ndarray) -> np.ndarray:
    """d(k1, k2)/d(eta) (..., 2, 2) of `principal` parameters."""
    a1, a2 = np.tanh(eta[..., 0]), np.tanh(eta[..., 1])
    s1, s2 = 1 - a1 * a1, 1 - a2 * a2
    product = 1 + a1 * a2
    rows = [
        [-s1 / (1 + a1), -s2 / (1 - a2)],
        [s1 * (1 / (1 + a1) - a2 / product), -s2 * a1 / product],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
