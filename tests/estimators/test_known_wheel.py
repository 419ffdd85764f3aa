"""A wheel whose rate was measured (`rotor0`) in estimates: the smoother takes it, others say that they do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprops.diagnosis.measured_beside import effects_beside
from massprops.diagnosis.record import record_of_attitudes, record_of_rates
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import from_rotation_vector, multiply
from massprops.dynamics.rotation import trajectory
from massprops.estimators.estimate import estimate_all
from massprops.estimators.outcome import Outcome
from massprops.model import Model
from massprops.model.measured_wheel import measured_wheel
from massprops.model.problem import problem_of
from massprops.sequence.data import AttitudeSeries, Environment, RateSeries, RotorSeries, Sequence

INERTIA = np.array([[0.8, 0.05, 0.0], [0.05, 1.0, 0.0], [0.0, 0.0, 1.2]])
MOMENTUM = np.array([0.04, -0.02, 0.1])
STAMP = 2 * 10**9 + np.arange(0, 120 * 10**9, 5 * 10**8)


def spun(sensor: str) -> Sequence:
    """Attitudes or rates of a body whose wheel runs up between 40 and 60 s."""
    times = (STAMP - STAMP[0]) * 1e-9
    rotor = RotorSeries(STAMP, 200.0 * np.clip((times - 40.0) / 20.0, 0.0, 1.0))
    model = Model((measured_wheel(rotor, int(STAMP[0]), int(STAMP[-1]), int(STAMP[0])),), (MOMENTUM,))
    moved = trajectory(
        times, np.array([1.0, 0, 0, 0]), np.array([0.1, 0.15, -0.08]), INERTIA, model.active, MOMENTUM, EnvironmentModel(Environment())
    )  # fmt: skip
    noise = 1e-3 * np.random.default_rng(0).standard_normal((len(times), 3))
    if sensor == "rates":
        return Sequence(rates=RateSeries(STAMP, moved.w + noise, 1e-3), rotor=rotor)
    q = multiply(moved.q, from_rotation_vector(noise))
    return Sequence(attitude=AttitudeSeries(STAMP, q, np.full(len(times), 1e-3)), rotor=rotor)


@pytest.fixture(scope="module", params=["attitude", "rates"])
def outcome(request: pytest.FixtureRequest) -> Outcome:
    return estimate_all(spun(request.param))


def test_the_smoother_follows_the_wheel(outcome: Outcome) -> None:
    (found,) = (e for e in outcome.estimates if e.name == "smoother")
    assert found.reliable and found.sigma_k is not None
    off = np.array([found.k1, found.k2], float) - ratios(INERTIA)[0]
    assert (np.abs(off) < 4.0 * found.sigma_k).all() and (np.abs(off) < 0.05).all()


def test_no_other_method_is_reliable(outcome: Outcome) -> None:
    others = [e for e in outcome.estimates if e.name != "smoother"]
    assert others and not any(e.reliable for e in others) and all(e.because for e in others)


def test_a_model_without_it_is_obeyed_and_said(tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    path.write_text("format: massprops-model/1\neffects:\n- {name: viscous-damping, parameters: {damping: 0}}\n")
    said = estimate_all(spun("attitude"), ["smoother"], model=path).warnings
    assert any("rotor0 is not used" in line for line in said)


def test_without_the_rate_nothing_is_reliable() -> None:
    found = estimate_all(replace(spun("attitude"), rotor=None), ["smoother"]).estimates[0]
    assert not found.reliable


def test_times_count_from_the_first_timestamp_everywhere() -> None:
    """Also where both take means of a gyroscope's rates, over stretches of their own."""
    stamp = STAMP[0] + np.arange(0, 4 * 10**9, 10**6)
    times = (stamp - stamp[0]) * 1e-9
    alike = np.convolve(np.random.default_rng(1).standard_normal(len(times) + 31), np.ones(32) / 32, "valid")
    w = np.stack([np.cos(times), np.sin(times), 0.5 + 0.0 * times], axis=1) + 0.01 * alike[:, None]
    sequence = Sequence(rates=RateSeries(stamp, w), rotor=RotorSeries(stamp, 200.0 * np.clip(times - 2.0, 0.0, 1.0)))
    assert sequence.rates is not None
    problem, record = problem_of(sequence), record_of_rates(sequence.rates)
    assert len(problem.times) < len(times) and problem.first_ns == STAMP[0]
    for at, since in ((problem.stamp_ns, problem.times), (record.stamp, record.times)):
        assert np.allclose((at - STAMP[0]) * 1e-9, since, atol=1e-9)
    (wheel,) = effects_beside(sequence)
    assert wheel.GIVEN["times_s"][0] == pytest.approx(0.0, abs=2e-3)


def test_so_they_do_where_a_gyroscope_begins_before_the_attitudes() -> None:
    attitude, rates = spun("attitude").attitude, spun("rates").rates
    assert attitude is not None and rates is not None
    late = AttitudeSeries(attitude.timestamp_ns[20:], attitude.q[20:], attitude.sigma[20:])
    record, problem = record_of_attitudes(late, Environment(), rates), problem_of(Sequence(attitude=late, rates=rates))
    assert record.times[0] == pytest.approx(10.0) and problem.times[0] == 0.0
    assert np.allclose((record.row_stamp - STAMP[0]) * 1e-9, record.row_times, atol=1e-9)
