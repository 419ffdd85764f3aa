"""Spread of numbers: their root mean square, and of numbers among which some are wrong the median absolute deviation (Hampel 1974)."""

from __future__ import annotations

import numpy as np

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def rms(values: np.ndarray) -> float:
    """Root mean square of numbers of any shape."""
    return float(np.sqrt(np.mean(np.square(values))))


def mad_sigma(deviation: np.ndarray) -> float:
    """1-sigma of deviations from their middle, of any shape, as if they were normal."""
    return MAD_TO_SIGMA * float(np.median(np.abs(deviation)))


def nanmedian(values: np.ndarray, axis: int) -> np.ndarray:
    """As numpy's, to the last bit and without its warning, along an axis of few values: there its own takes several times as long."""
    ordered = np.sort(values, axis=axis)
    count = np.sum(~np.isnan(values), axis=axis, keepdims=True)
    low, high = (np.take_along_axis(ordered, np.maximum(k, 0), axis) for k in ((count - 1) // 2, count // 2))
    middle = np.where(count > 0, (low + high) / values.dtype.type(2), values.dtype.type(np.nan))
    return np.asarray(middle.squeeze(axis))
