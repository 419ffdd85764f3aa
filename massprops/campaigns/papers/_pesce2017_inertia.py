"""pesce2017's filter: the inertia up to scale as two unconstrained parameters, which a filter can add to.

The body frame is the principal frame. Euler's equations are w1_dot = a1 w2 w3 and so on with

    a1 = (I2 - I3)/I1, a2 = (I3 - I1)/I2, a3 = (I1 - I2)/I3.

They are tied by a1 + a2 + a3 + a1 a2 a3 = 0, and a body of positive mass has |a| < 1 (the triangle inequality). The parameters are
a's coordinates in the plane a1 + a2 + a3 = 0. For most bodies the surface of possible a departs from it by no more than a few
hundredths, so the motion is nearly linear in them. It is not in k1, k2. Plates and rods, where k1, k2 run off, are ordinary points.

All functions are component-wise on the last axis, for real and complex arrays.
"""

from __future__ import annotations

import numpy as np

Six = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]

PARAMETERS = 2

LARGEST_A = 0.995
"""Bodies more slender than this are not looked for."""

ANY_BODY = 0.1
"""Share of a prior that is given to all possible bodies alike."""

PLANE = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])


def within(parameters: np.ndarray) -> np.ndarray:
    """The parameters (..., 2), moved towards zero where they leave the bodies that are looked for."""
    for _ in range(3):
        most = np.abs(np.stack(coupling(parameters), axis=-1)).max(axis=-1, keepdims=True)
        parameters = parameters * np.where(most > LARGEST_A, LARGEST_A / most, 1.0)
    return parameters


def coupling(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a1, a2, a3 of parameters (..., 2)."""
    p1, p2 = parameters[..., 0], parameters[..., 1]
    a1, a2, a3 = (PLANE[0, i] * p1 + PLANE[1, i] * p2 for i in range(3))
    s = -a1 * a2 * a3 / 3.0
    for _ in range(6):
        b1, b2, b3 = a1 + s, a2 + s, a3 + s
        s = s - (3.0 * s + b1 * b2 * b3) / (3.0 + b1 * b2 + b2 * b3 + b3 * b1)
    return a1 + s, a2 + s, a3 + s


def components(parameters: np.ndarray) -> Six:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz, each (...), of parameters (..., 2)."""
    a1, a2, a3 = coupling(parameters)
    zero = np.zeros_like(a1)
    return 3.0 + a2 * a3 + a3 - a2, 3.0 + a3 * a1 + a1 - a3, 3.0 + a1 * a2 + a2 - a1, zero, zero, zero


def ratios_of(parameters: np.ndarray) -> np.ndarray:
    """k1 = ln(Ix/Iy), k2 = ln(Iy/Iz) (..., 2) of parameters (..., 2), axes in their own order."""
    xx, yy, zz, *_ = components(parameters)
    return np.stack([np.log(xx / yy), np.log(yy / zz)], axis=-1)


def from_ratios(k: np.ndarray) -> np.ndarray:
    """parameters (..., 2) of k1, k2 (..., 2); an impossible body becomes the nearest possible in each."""
    return within(np.clip(_couplings(k), -LARGEST_A, LARGEST_A) @ PLANE.T)


def _couplings(k: np.ndarray) -> np.ndarray:
    """a (..., 3) of k1, k2, possible or not."""
    x, z = np.exp(k[..., 0]), np.exp(-k[..., 1])
    return np.stack([(1.0 - z) / x, z - x, (x - 1.0) / z], axis=-1)


def principal_prior(k: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (B, 2) and covariance (B, 2, 2) of parameters when k1, k2 are believed normal about k (B, 2) with `sigma` (2,).

    Only possible bodies count (|a1|, |a2|, |a3| < 1): moments of what is left of the normal distribution over a grid.
    A belief that no possible body comes near becomes the nearest possible body, as uncertain as can be.
    """
    line = np.linspace(-4.0, 4.0, 61)
    g1, g2 = np.meshgrid(line, line, indexing="ij")
    means, covariances = [], []
    for centre in np.atleast_2d(k):
        grid = np.stack([centre[0] + sigma[0] * g1.ravel(), centre[1] + sigma[1] * g2.ravel()], axis=-1)
        a = from_ratios(grid)
        possible = (np.abs(_couplings(grid)) < LARGEST_A).all(axis=-1)
        weight = np.where(possible, np.exp(-0.5 * (g1.ravel() ** 2 + g2.ravel() ** 2)), 0.0)
        if weight.sum() < 1e-6:
            means.append(0.9 * from_ratios(centre))
            covariances.append(np.eye(2) / 3)
            continue
        # a belief that few bodies can meet would leave a sliver and a false certainty: some weight goes to all of them
        weight = (1 - ANY_BODY) * weight / weight.sum() + ANY_BODY * possible / possible.sum()
        mean = weight @ a
        off = a - mean
        means.append(mean)
        covariances.append((off * weight[:, None]).T @ off)
    return np.stack(means), np.stack(covariances)


def ratios_jacobian(parameters: np.ndarray) -> np.ndarray:
    """d(k1, k2)/d(parameters) (..., 2, 2) of parameters, by the complex step."""
    columns = []
    for i in range(PARAMETERS):
        moved = parameters.astype(complex)
        moved[..., i] += 1e-150j
        columns.append(ratios_of(moved).imag / 1e-150)
    return np.stack(columns, axis=-1)
