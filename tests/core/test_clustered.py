"""A fit's covariance where errors are alike within clusters, each judged without itself."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.core.clustered import Scores, multiway_meat


def seen(x: np.ndarray, error: np.ndarray) -> Scores:
    """Observations of two coordinates of a line, y = x b + error, after its fit."""
    slope = np.stack([x, np.zeros_like(x)], axis=1)[:, :, None]
    slope = np.concatenate([slope, np.ones_like(slope) * [[[1.0], [0.0]]]], axis=2)
    design = slope[:, 0]
    left = error - design @ np.linalg.lstsq(design, error, rcond=None)[0]
    root = np.linalg.inv(np.linalg.cholesky(design.T @ design))
    return Scores(design * left[:, None], slope, root)


def variance(found: np.ndarray, one: Scores) -> np.ndarray:
    inverse = one.root.T @ one.root
    return np.diag(inverse @ found @ inverse)


def test_it_is_the_jackknife() -> None:
    rng = np.random.default_rng(1)
    x, label = np.linspace(-1, 2, 60), np.repeat(np.arange(6), 10)
    error = rng.standard_normal(60) + rng.standard_normal(6)[label]
    design = np.column_stack([x, np.ones(60)])
    whole = np.linalg.lstsq(design, error, rcond=None)[0]
    moved = np.array([np.linalg.lstsq(design[label != g], error[label != g], rcond=None)[0] - whole for g in range(6)])
    own = seen(x, error)
    np.testing.assert_allclose(variance(multiway_meat(own, (label,)), own), 5 / 6 * (moved**2).sum(axis=0), rtol=1e-9)


def test_errors_alike_on_one_side_of_the_camera_count() -> None:
    rng = np.random.default_rng(2)
    real, without, told = [], [], []
    for _ in range(60):
        x = rng.standard_normal(400)
        side, block, place = (x > 0).astype(int) + 2 * (np.abs(x) > 1), np.arange(400) // 50, rng.integers(0, 10, 400)
        error = rng.standard_normal(400) + 0.7 * rng.standard_normal(4)[side]
        design = np.column_stack([x, np.ones(400)])
        real.append(np.linalg.lstsq(design, error, rcond=None)[0][0])
        own = seen(x, error)
        without.append(variance(multiway_meat(own, (place, block)), own)[0])
        told.append(variance(multiway_meat(own, (place, block, side)), own)[0])
    actual = np.std(real)
    assert np.sqrt(np.mean(without)) < 0.5 * actual
    assert np.sqrt(np.mean(told)) == pytest.approx(actual, rel=0.5)


def test_a_cluster_that_holds_all_of_a_number_stays_finite() -> None:
    x = np.r_[np.zeros(20), 1.0]
    own = seen(x, np.random.default_rng(3).standard_normal(21))
    assert np.isfinite(multiway_meat(own, (np.r_[np.zeros(20, int), 1],))).all()
