"""Attitudes whose errors hang together, as structure from motion gives them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tumbling import Scene, scene

from massprops.dynamics.quaternion import from_rotation_vector, multiply
from massprops.estimators.attitude_noise import inflation_of, with_correlated_noise
from massprops.estimators.methods import methods
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess
from massprops.model.problem import Problem

SIGMA, N = 0.003, 120


def errors(rng: np.random.Generator, rho: float, n: int = N) -> np.ndarray:
    x = rng.standard_normal((n, 3))
    for i in range(1, n):
        x[i] = rho * x[i - 1] + np.sqrt(1 - rho**2) * x[i]
    return x


def only_attitude(seed: int, rho: float) -> tuple[Scene, Problem]:
    s = scene(seed, n=N, dt=1.0, stereo=False, attitude=True)
    turned = multiply(s.q, from_rotation_vector(SIGMA * errors(np.random.default_rng([seed, 77]), rho)))
    problem = replace(
        s.problem,
        attitude=turned,
        sigma_attitude=np.full(N, SIGMA),
        cameras=(),
        uv=np.full((N, 0, 0, 2), np.nan),
        sigma_px=np.zeros(0),
        features=np.zeros(0, int),
    )
    return s, problem


def test_what_errors_are_worth() -> None:
    rng = np.random.default_rng(1)
    tau = np.linspace(-1, 1, 300)
    slope = np.stack(
        [np.stack([tau**p * (axis == i) for axis in range(3)], axis=1) for i in range(3) for p in range(3)], 2
    )
    assert inflation_of(rng.standard_normal((300, 3)), slope) == (1.0, 1.0)
    found = [inflation_of(errors(rng, 0.9, 300), slope)[0] for _ in range(8)]
    assert 0.7 < np.mean(found) / np.sqrt(19.0) < 1.5  # (1 + 0.9)/(1 - 0.9) epochs for one
    # errors larger than stated, but white, are for the filters' own tests
    assert inflation_of(2.0 * rng.standard_normal((300, 3)), slope) == (1.0, 1.0)


@pytest.mark.parametrize("name", ["ekf", "ukf", "momentum-ls"])
def test_sigmas_hold_where_errors_hang_together(name: str) -> None:
    before, after = [], []
    for seed in range(5):
        s, problem = only_attitude(seed, 0.9)
        wider, line = with_correlated_noise(problem, first_guess(problem))
        assert "alike" in line and wider.alike > 1.5
        for given, out in ((problem, before), (wider, after)):
            found = methods()[name].estimate(given, Prior(), first_guess(given))
            if found.k_covariance is not None:
                off = np.array([found.k1, found.k2]) - s.k
                out.append(float(off @ np.linalg.solve(found.k_covariance, off)) / 2)
    # the least squares' own windows see none of such errors, so that it goes by what is stated all the same
    assert name == "momentum-ls" or np.median(before) > 3.0
    assert 0.03 < np.median(after) < 3.0


def test_attitudes_that_follow_a_free_motion_exactly_are_no_surer_than_stated() -> None:
    s, noisy = only_attitude(3, 0.0)
    smooth = replace(noisy, attitude=s.q)
    exact, white = (methods()["momentum-ls"].estimate(p, Prior(), first_guess(p)) for p in (smooth, noisy))
    assert np.all(np.diag(exact.k_covariance) > 0.5 * np.diag(white.k_covariance))
    assert np.all(exact.sigma_w > 0.5 * white.sigma_w)


def test_white_errors_are_left_alone() -> None:
    for seed in range(3):
        _, problem = only_attitude(seed, 0.0)
        same, line = with_correlated_noise(problem, first_guess(problem))
        assert same is problem and line == ""


def test_axes_of_the_unscented_filter_are_as_sure_as_it_says() -> None:
    squares = []
    for seed in range(6):
        s, problem = only_attitude(seed, 0.0)
        found = methods()["ukf"].estimate(problem, Prior(), first_guess(problem))
        assert found.converged and found.observable
        true = s.axes * np.sign(np.sum(s.axes * found.principal_axes, axis=0))
        turn = 0.5 * np.cross(found.principal_axes, true, axisa=0, axisb=0, axisc=0).sum(axis=1)
        squares.append(float(turn @ np.linalg.solve(found.axes_covariance, turn)) / 3)
    assert np.mean(squares) < 4.0
