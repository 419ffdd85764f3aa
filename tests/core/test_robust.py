"""Robust spreads, and medians where numbers are missing."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from massprops.core.robust import mad_sigma, nanmedian


def test_the_sigma_of_normal_numbers_is_found_in_spite_of_outliers() -> None:
    x = np.random.default_rng(0).normal(0.0, 2.5, 20_000)
    assert mad_sigma(x) == pytest.approx(2.5, rel=0.02)
    x[:1000] = 1e6
    assert mad_sigma(x) == pytest.approx(2.5, rel=0.1)


def test_it_scales_with_the_numbers_and_not_with_their_sign() -> None:
    x = np.random.default_rng(1).normal(size=(40, 3))
    assert mad_sigma(-3.0 * x) == pytest.approx(3.0 * mad_sigma(x), rel=1e-12)


@pytest.mark.parametrize(("shape", "axis"), [((24, 40, 3), 0), ((7, 9), 1), ((1, 5), 0)])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_median_of_what_is_known_is_that_of_numpy(shape: tuple[int, ...], axis: int, kind: type) -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(100.0, 30.0, shape).astype(kind)
    values[rng.random(shape) < 0.3] = np.nan
    values[(slice(None), 3) if axis == 0 else 3] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        expected = np.nanmedian(values, axis=axis)
    found = nanmedian(values, axis)
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == expected.dtype
