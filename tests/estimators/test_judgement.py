"""What an estimate says about itself: finite, white, alike over its halves, in agreement with the smoother."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimators.made_sequence import make_sequence, simple_method

from massprops.errors import NotPossible
from massprops.estimators import methods as registry
from massprops.estimators.estimate import estimate_all
from massprops.estimators.judgement import against, judged, memory_of
from massprops.estimators.result import Estimate
from massprops.model.problem import Problem, problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

RATES = {"features": 0, "rate_sigma": 3e-4, "range_sigma_m": 0.0, "frames": 120, "rate_deg": 6.0}
ATTITUDE = {"features": 0, "attitude_sigma": 2e-3, "range_sigma_m": 0.0, "frames": 120, "rate_deg": 6.0}
FILTERS = ["momentum-ls", "ekf", "ukf", "smoother"]


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of(simulate_tracks(TrackScenario(**ATTITUDE)).sequence)


def sound(**changes: object) -> Estimate:
    """An estimate with nothing against it."""
    base = Estimate(
        "m", True, True, k1=-0.3, k2=-0.2, k_covariance=1e-4 * np.eye(2), inertia=np.diag([0.25, 0.33, 0.42]),
        innovation=1.0,
    )  # fmt: skip
    return replace(base, **changes)


def test_a_sound_estimate_is_reliable(problem: Problem) -> None:
    found = judged(sound(), problem)
    assert found.converged and found.observable and found.reliable and not found.because


@pytest.mark.parametrize(
    "wrong",
    [
        {"k1": np.nan},
        {"k1": None},
        {"k1": -8.6, "k_covariance": 0.09 * np.eye(2)},
        {"inertia": np.diag([0.1, 0.2, 0.7])},
        {"k_covariance": np.diag([-1e-4, 1e-4])},
        {"w": np.full((3, 3), np.inf), "converged": False, "reason": "the filter's state is not finite"},
    ],
)
def test_what_is_no_body_is_neither_converged_nor_observable(problem: Problem, wrong: dict) -> None:
    found = judged(sound(**wrong), problem)
    assert not found.converged and not found.observable and not found.reliable
    assert found.k1 is None and found.k_covariance is None and found.because


def test_size_and_correlation_count_together(problem: Problem) -> None:
    rng = np.random.default_rng(0)
    white = rng.normal(size=(200, 3))
    # correlation .8 from epoch to epoch: alike over (1 + .8) / (1 - .8) = 9 epochs
    slow = np.array(white)
    for k in range(1, len(slow)):
        slow[k] = 0.8 * slow[k - 1] + 0.6 * white[k]
    assert memory_of(white) == 1.0 and 5.0 < memory_of(slow) < 13.0
    assert judged(sound(residuals=white, innovation=1.3), problem).reliable
    loud = judged(sound(residuals=white, innovation=5.0), problem)
    assert not loud.reliable and "2.2 times as large" in loud.because
    alike = judged(sound(residuals=slow, innovation=1.0), problem)
    assert not alike.reliable and "are correlated over" in alike.because
    assert judged(sound(residuals=slow, innovation=0.05), problem).reliable, "sigmas widened for it are as they should"


def test_halves_that_contradict_each_other(problem: Problem) -> None:
    spread = 1e-6 * np.eye(5)
    near, far = (np.zeros(5), spread), (np.full(5, 0.01), spread)
    assert judged(sound(halves=(near, near)), problem).reliable
    found = judged(sound(halves=(near, far)), problem)
    assert not found.reliable and "two halves" in found.because
    k = np.full((40, 2), -0.3) + np.linspace(0.2, 0, 40)[:, None]
    filtered = judged(sound(k_history=k, k_sigma_history=np.full((40, 2), 0.01)), problem)
    assert not filtered.reliable and "second half" in filtered.because


def test_a_method_far_from_a_reliable_smoother_is_not_reliable() -> None:
    reference = sound(name="smoother", reliable=True)
    near, far = sound(reliable=True, k1=-0.31), sound(reliable=True, k1=-0.4)
    assert against(near, reference).reliable and not against(far, reference).reliable
    assert against(far, replace(reference, reliable=False)).reliable


@pytest.mark.parametrize(("sensor", "size"), [(RATES, 3e-4), (ATTITUDE, 1e-3)])
def test_free_motion_is_reliable_and_a_hidden_torque_is_not(sensor: dict, size: float) -> None:
    free = estimate_all(simulate_tracks(TrackScenario(**sensor, seed=3)).sequence, FILTERS)
    assert {e.name for e in free.sound} == set(FILTERS), free.estimates
    torque = f"constant-body-torque:torque_x={size},torque_y=0,torque_z={-size / 2}"
    pushed = estimate_all(simulate_tracks(TrackScenario(**sensor, seed=3, effects=(torque,))).sequence, FILTERS)
    assert len(pushed.estimates) == len(FILTERS)
    assert not pushed.sound and all(e.because for e in pushed.estimates), pushed.estimates


def test_one_impossible_method_costs_no_other(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    found = {"simple": simple_method(), "ranger": simple_method("ranger", ("range", "tracks"))}
    monkeypatch.setattr(registry, "methods", lambda: found)
    folder = make_sequence(tmp_path / "seq")
    outcome = estimate_all(folder, ["ranger", "simple"])
    assert [e.name for e in outcome.estimates] == ["simple"] and "range0" in outcome.skipped["ranger"]
    with pytest.raises(NotPossible, match="ranger needs"):
        estimate_all(folder, ["ranger"])


def test_a_models_own_state_is_where_the_smoother_begins(problem: Problem, tmp_path) -> None:  # type: ignore[no-untyped-def]
    import yaml

    from massprops.errors import InputError
    from massprops.estimators.methods import smoother
    from massprops.model import load_model
    from massprops.model.state import BatchState

    path = tmp_path / "model.yaml"
    content = {
        "format": "massprops-model/1", "effects": [], "inertia": np.diag([0.8, 1.0, 1.2]).tolist(),
        "angular_velocity_rad_s": [0.1, 0.2, 0.3], "attitude": [0.6, 0.8, 0.0, 0.0],
    }  # fmt: skip
    path.write_text(yaml.safe_dump(content))
    model = load_model(path)
    blank = BatchState(
        np.array([1.0, 0, 0, 0]), np.ones(3), np.ones(3), np.zeros(3), np.eye(3), model, np.zeros((0, 3))
    )
    begun = smoother._state_of_model(blank, model, problem)
    assert begun is not None and np.allclose(begun.w0, [0.1, 0.2, 0.3]) and np.allclose(begun.q0, [0.6, 0.8, 0, 0])
    assert np.allclose(begun.inertia, np.diag([0.8, 1.0, 1.2]))
    path.write_text(yaml.safe_dump({**content, "attitude": [1.0, 1.0, 0.0, 0.0]}))
    with pytest.raises(InputError, match="unit quaternion"):
        load_model(path)
    path.write_text(yaml.safe_dump({k: content[k] for k in ("format", "effects", "inertia")}))
    assert smoother._state_of_model(blank, load_model(path), problem) is None
