"""The line that says whether a filter's covariance means what it says."""

from __future__ import annotations

import numpy as np

from massprops.campaigns.consistency import consistency


def test_right_sigmas_are_inside_and_wrong_ones_named() -> None:
    e = np.random.default_rng(3).standard_normal((100, 6))
    right = np.sum(e**2, axis=1)
    right *= 6 / right.mean()
    assert "inside (95 % band" in consistency("a filter", right, 6)
    small = consistency("a filter", 4.0 * right, 6)
    assert "OUTSIDE, sigmas too small by 2" in small and "a filter" in small
    assert "OUTSIDE, sigmas too large by 2" in consistency("a filter", right / 4.0, 6)
    assert consistency("a filter", np.array([np.nan]), 6) == "NEES of a filter: no run"
