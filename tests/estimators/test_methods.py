"""Every estimator passes the same list, and one more needs one file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from tumbling import Scene, scene

from massprops.estimators.estimate import run_methods
from massprops.estimators.methods import faults, methods, own
from massprops.estimators.needs import unmet
from massprops.estimators.result import Estimate
from massprops.model.problem import Problem

BLIND = {"range-ukf": (1, {"stereo": False, "attitude": True, "range_sigma": 0.02})}
"""Seed and set-up of what an estimator is tried on where stereo tracks alone are not what it reads."""


def scene_of(name: str) -> Scene:
    seed, more = BLIND.get(name, (0, {}))
    return scene(seed, **more)


def seen_by(name: str) -> Problem:
    return scene_of(name).problem


def ran(name: str, problem: Problem) -> Estimate:
    outcome = run_methods(problem, [methods()[name]])
    assert not outcome.skipped, outcome.skipped
    return outcome.estimates[0]


@pytest.fixture(scope="module", params=own())
def found(request: pytest.FixtureRequest) -> Estimate:
    problem, untouched = seen_by(request.param), seen_by(request.param)
    answer = ran(request.param, problem)
    for field in fields(problem):
        a, b = getattr(problem, field.name), getattr(untouched, field.name)
        assert not isinstance(a, np.ndarray) or np.array_equal(a, b, equal_nan=True), f"{field.name} was written to"
    return answer


@pytest.mark.parametrize("name", own())
def test_its_file_says_what_it_must(name: str) -> None:
    method = own()[name]
    assert faults(method) == ""
    assert Path(str(method.__file__)).stem == name.replace("-", "_")


@pytest.mark.parametrize("name", own())
def test_what_is_missing_is_named(name: str) -> None:
    problem = seen_by(name)
    blank = {part: np.full_like(getattr(problem, part), np.nan) for part in ("uv", "range_m", "rates", "attitude")}
    assert not unmet(own()[name], problem)
    assert unmet(own()[name], replace(problem, **blank)).startswith("needs ")


def test_the_answer_is_right_and_says_how_sure_it_is(found: Estimate) -> None:
    truth = scene_of(found.name).k
    assert found.converged and found.observable and found.reason == ""
    assert found.sigma_k is not None and (found.sigma_k > 0).all()
    off = np.array([found.k1, found.k2]) - truth
    assert (np.abs(off) < 5 * found.sigma_k + 1e-3).all() and np.abs(off).max() < 0.1


def test_shapes_and_what_must_hold_of_them(found: Estimate) -> None:
    n = len(found.times)
    assert n > 10 and (np.diff(found.times) > 0).all()
    assert found.q is not None and found.w is not None and found.inertia is not None
    assert found.q.shape == (n, 4) and np.allclose(np.linalg.norm(found.q, axis=1), 1)
    assert found.w.shape == (n, 3)
    for name in ("sigma_attitude", "sigma_w", "position", "velocity", "sigma_position", "sigma_velocity"):
        value = getattr(found, name)
        assert value is None or value.shape == (n, 3), name
        assert value is None or not name.startswith("sigma") or np.nanmin(value) >= 0, name
    for name in ("k_history", "k_sigma_history"):
        assert getattr(found, name) is None or getattr(found, name).shape == (n, 2), name
    assert np.isclose(np.trace(found.inertia), 1.0) and np.allclose(found.inertia, found.inertia.T)
    assert found.principal_axes is not None and np.isclose(abs(np.linalg.det(found.principal_axes)), 1.0)
    assert found.k_covariance is not None and found.axes_covariance is not None
    for covariance, size in ((found.k_covariance, 2), (found.axes_covariance, 3)):
        assert covariance.shape == (size, size) and np.allclose(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance).min() > -1e-12
    moments = np.linalg.eigvalsh(found.inertia)
    assert np.allclose(np.log(moments[:2] / moments[1:]), [found.k1, found.k2], atol=1e-9)
    assert found.body_frame in ("own", "attitude0") and found.used > 0 and found.gated >= 0
    assert (found.features is None) == (found.feature_ids is None)


def test_the_same_data_give_the_same_answer(found: Estimate) -> None:
    again = ran(found.name, seen_by(found.name))
    for field in fields(found):
        if field.name != "cpu_us_per_step":
            a, b = getattr(found, field.name), getattr(again, field.name)
            assert np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else str(a) == str(b), field.name


GOOD = '''
"""The first guess itself."""
from massprops.dynamics.inertia import ratios
from massprops.estimators.result import Estimate

NAME = "first-guess"
SENTENCE = "the first guess itself"
NEEDS = ("stereo|attitude",)


def estimate(problem, prior, start):
    k, _ = ratios(start.inertia)
    return Estimate(NAME, True, True, k1=float(k[0]), k2=float(k[1]), inertia=start.inertia, times=start.times, q=start.q)
'''


def test_a_package_brings_an_estimator_in_one_file(with_package: Callable[..., str]) -> None:
    """An entry point is known like a file of massprops; a bad one is left out, with the reason."""
    code = """
import massprops
from massprops.estimators.methods import refused
found = massprops.estimate(massprops.simulate("tracks", frames=60, seed=3), method="first-guess")
print(found[0].name, list(refused().values()))
"""
    said = with_package("massprops.estimators", code, good=GOOD, bad=GOOD.replace("stereo|attitude", "sonar"))
    assert said.startswith("first-guess ['NEEDS must be a tuple of any of: tracks")
