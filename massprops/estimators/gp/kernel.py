"""The product of two periodic kernels as a sum of spectral lines.

The kernel of kabir2025 (section 2.3), with d = t - t',

    k(d) = exp(-sin^2(pi d f1) / (2 l1^2)) exp(-sin^2(pi d f2) / (2 l2^2)),

has the Fourier series exp(-z) exp(z cos x) = exp(-z) [I_0(z) + 2 sum_n I_n(z) cos(n x)], z = 1 / (4 l^2). So k is
exactly a sum of cosines at the frequencies a f1 + b f2, and a process with this kernel is a Bayesian regression on
those lines: O(n r^2) for r lines in place of O(n^3), exact to rounding, at any times (missing frames included), and
its derivative in time is known in closed form.
"""

from __future__ import annotations

import numpy as np


def lattice(order: int) -> np.ndarray:
    """Integer pairs (a, b) of the lines a f1 + b f2, one of each pair of opposite sign.

    Args:
        order: largest |a| and |b|.

    Returns:
        (m, 2) int; the first row is (0, 0).
    """
    n = np.arange(1, order + 1)
    a, b = np.meshgrid(n, np.concatenate([n, -n]), indexing="ij")
    pairs = np.column_stack([a.ravel(), b.ravel()])
    axis = np.column_stack([n, np.zeros_like(n)])
    return np.concatenate([np.zeros((1, 2), int), axis, axis[:, ::-1], pairs])


def line_weights(orders: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share of the kernel's variance in each line, and its logarithmic derivative by z.

    Args:
        orders: (m, 2) from `lattice`.
        z: (2,) 1 / (4 l^2), l the length scales of the two factors.

    Returns:
        weights (m,), sum 1 as the order grows; derivatives (m, 2) of log(weight) by z.
    """
    from scipy.special import ive

    n = np.abs(orders)
    bessel = ive(n, z)
    weight = np.prod(bessel, axis=1) * np.where(np.any(orders != 0, axis=1), 2.0, 1.0)
    slope = (ive(np.abs(n - 1), z) + ive(n + 1, z)) / (2.0 * bessel) - 1.0
    return weight, slope


def features(t: np.ndarray, orders: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Cosine and sine of every line.

    Args:
        t: (n,) times [s].
        orders: (m, 2) with (0, 0) first.
        f: (2,) fundamental frequencies [Hz].

    Returns:
        (n, 2m - 1): the constant, m - 1 cosines, m - 1 sines.
    """
    return waves(t, orders[1:] @ f)


def waves(t: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """(n, 2m + 1) at times (n,) [s]: the constant, then cosines and sines of frequencies (m,) [Hz]."""
    phase = 2.0 * np.pi * np.outer(t, lines)
    return np.concatenate([np.ones((len(t), 1)), np.cos(phase), np.sin(phase)], axis=1)


def feature_rates(phi: np.ndarray, orders: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Derivative in time of `features`, from the features (n, 2m - 1) themselves."""
    m = len(orders) - 1
    omega = 2.0 * np.pi * (orders[1:] @ f)
    out = np.zeros_like(phi)
    out[:, 1 : m + 1] = -omega * phi[:, m + 1 :]
    out[:, m + 1 :] = omega * phi[:, 1 : m + 1]
    return out


def feature_jacobian(phi: np.ndarray, t: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Derivative of `features` by the two fundamental frequencies: (2, n, 2m - 1)."""
    m = len(orders) - 1
    out = np.zeros((2, *phi.shape))
    for k in range(2):
        arm = 2.0 * np.pi * np.outer(t, orders[1:, k])
        out[k, :, 1 : m + 1] = -arm * phi[:, m + 1 :]
        out[k, :, m + 1 :] = arm * phi[:, 1 : m + 1]
    return out


def per_column(line_values: np.ndarray) -> np.ndarray:
    """Spreads a value per line over the columns of `features`: (m, ...) to (2m - 1, ...)."""
    return np.concatenate([line_values[:1], line_values[1:], line_values[1:]])
