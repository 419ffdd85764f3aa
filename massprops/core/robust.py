"""Spread of numbers among which some are wrong: the median absolute deviation (Hampel 1974)."""

from __future__ import annotations

import numpy as np

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def mad_sigma(deviation: np.ndarray) -> float:
    """1-sigma of deviations from their middle, of any shape, as if they were normal."""
    return MAD_TO_SIGMA * float(np.median(np.abs(deviation)))
