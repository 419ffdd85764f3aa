"""Robust spreads."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.core.robust import mad_sigma


def test_the_sigma_of_normal_numbers_is_found_in_spite_of_outliers() -> None:
    x = np.random.default_rng(0).normal(0.0, 2.5, 20_000)
    assert mad_sigma(x) == pytest.approx(2.5, rel=0.02)
    x[:1000] = 1e6
    assert mad_sigma(x) == pytest.approx(2.5, rel=0.1)


def test_it_scales_with_the_numbers_and_not_with_their_sign() -> None:
    x = np.random.default_rng(1).normal(size=(40, 3))
    assert mad_sigma(-3.0 * x) == pytest.approx(3.0 * mad_sigma(x), rel=1e-12)
