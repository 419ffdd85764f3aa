"""The turn between a filter's own axes and the body axes that an attitude history names."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import conjugate, mean_quaternion, multiply


def mean_turn(attitude: np.ndarray, q: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, float]:
    """Weighted mean turn (4,) from a filter's axes, of attitude q, to those of `attitude`, and the variance of its mean.

    Args:
        attitude, q: (n, 4), both to cam0; variance: (n,) of their difference [rad^2].
    """
    there = np.isfinite(attitude[:, 0]) & np.isfinite(variance)
    turns = multiply(conjugate(attitude[there]), q[there])
    # the last epochs know q best, and its early errors are shared by many epochs
    weight = 1.0 / variance[there] ** 2
    spread = float(np.sum(weight**2 * variance[there]) / np.sum(weight) ** 2)
    return mean_quaternion(turns, weight), spread
