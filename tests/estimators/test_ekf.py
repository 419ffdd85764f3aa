"""EKF and iterated EKF on sequences of every kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.estimators.methods import methods
from massprops.estimators.result import Estimate, Prior
from massprops.estimators.start import first_guess
from massprops.model.problem import Problem, problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks


def scenario(**changes) -> tuple[Problem, dict]:
    made = simulate_tracks(TrackScenario(**({"frames": 140, "features": 10, "seed": 3} | changes)))
    return problem_of(made.sequence), made.truth


def run(name: str, problem: Problem) -> Estimate:
    prior = Prior()
    return methods()[name].estimate(problem, prior, first_guess(problem))


def check(found: Estimate, truth: dict, largest: float) -> None:
    assert found.converged and found.observable, found.reason
    error = np.array([found.k1 - truth["k1"], found.k2 - truth["k2"]])
    assert np.abs(error).max() < largest
    assert np.abs(error / found.sigma_k).max() < 4.5
    assert 0.3 < found.innovation < 1.3
    assert found.q.shape == (len(found.times), 4) and np.isfinite(found.w).all()


@pytest.mark.parametrize("name", ["ekf", "iekf"])
def test_stereo_tracks_with_outliers(name: str) -> None:
    problem, truth = scenario(outliers=0.03)
    found = run(name, problem)
    check(found, truth, 0.02)
    assert 0.01 < found.gated / (found.gated + found.used) < 0.15
    at = np.searchsorted(truth["timestamp_ns"], problem.stamp_ns[-1])
    assert np.linalg.norm(found.position[-1] - truth["position"][at]) < 6 * np.linalg.norm(found.sigma_position[-1])
    assert np.linalg.norm(found.w[-1]) == pytest.approx(np.linalg.norm(truth["w"][at]), rel=2e-3)


@pytest.mark.parametrize("kind", ["attitude", "rates", "one camera"])
def test_other_sensors(kind: str) -> None:
    changes = {
        "attitude": {"features": 0, "attitude_sigma": 0.01},
        "rates": {"features": 0, "rate_sigma": 1e-3},
        "one camera": {"baseline_m": 0.0, "attitude_sigma": 0.01},
    }[kind]
    problem, truth = scenario(range_sigma_m=0.0, orbit=False, **changes)
    found = run("iekf", problem)
    check(found, truth, 0.06)
    # one camera's tracks count beside the attitudes that were found from them
    assert (found.features is not None) == (kind == "one camera") and (found.body_frame == "own") == (kind == "rates")


def test_features_that_come_late_and_epochs_without_any() -> None:
    problem, truth = scenario(orbit=False)
    uv = problem.uv.copy()
    uv[:70, :, 6:] = np.nan
    uv[80:95] = np.nan
    found = run("iekf", replace(problem, uv=uv))
    check(found, truth, 0.03)
    assert set(problem.features[6:]) <= set(found.feature_ids.tolist())


def test_a_flat_spin_gives_no_number() -> None:
    problem, _ = scenario(moments=(1.0, 1.5, 2.0), spin=(0.0, 0.0, 1.0))
    found = run("iekf", problem)
    assert not found.observable and found.k1 is None and found.reason
