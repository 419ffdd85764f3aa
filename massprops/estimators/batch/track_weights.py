"""Weights of whole tracks: one that slides over the body, with a highlight or a shadow, is wrong from end to end.

Each of its observations is off by little, so that none is an outlier by itself, and all are off alike.
"""

from __future__ import annotations

import numpy as np

from massprops.core.robust import mad_sigma

HUBER, GATE = 3.0, 5.0
"""Residual, in units of the noise or of the bulk's misfit, beyond which a measurement, or a whole track, counts linearly, and
beyond which it is an outlier, left out of the result and counted."""


def weight_of(x: np.ndarray) -> np.ndarray:
    """Weights of residuals in these units, of any shape."""
    return np.where(x <= HUBER, 1.0, np.where(x <= GATE, HUBER / np.maximum(x, 1e-9), 0.0))


def bounded_square(x: np.ndarray) -> np.ndarray:
    """Weighted square of residuals in these units, of any shape; beyond `GATE`, and where there is none, that of the gate."""
    x = np.fmin(x, GATE)
    return np.minimum(x * x, HUBER * x)


def track_weights(residuals: np.ndarray, feature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(o,) weight of the track of each observation, and (o,) sum of squares that this track would have at the gate.

    A track of n observations whose errors are noise has a root mean square that scatters by 1 / (2 sqrt(n)) of it; errors
    that all tracks share make it larger for all. So a track is judged beside the others: by how far its misfit, in units
    of that scatter, lies above their middle, in units of their own spread.

    Args:
        residuals: (o, 2) in units of the noise; feature: (o,) whose they are.
    """
    if not len(residuals):
        return np.ones(0), np.zeros(0)
    at, count = np.unique(feature, return_inverse=True, return_counts=True)[1:]
    root = np.sqrt(np.bincount(at, np.sum(residuals**2, axis=1)) / (2 * count))
    usual = max(1.0, float(np.median(root)))
    misfit = (root / usual - 1.0) * 2.0 * np.sqrt(count)
    middle = float(np.median(misfit))
    spread = max(1.0, mad_sigma(misfit - middle))
    root_at_gate = usual * (1.0 + (middle + GATE * spread) / (2.0 * np.sqrt(count)))
    return np.asarray(weight_of((misfit - middle) / spread)[at]), np.asarray((2 * count * root_at_gate**2)[at])
