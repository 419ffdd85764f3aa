"""A wheel whose rate was measured: one number for each axis, in a diagnosis and in the model that it writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprops.diagnosis import selection
from massprops.diagnosis.candidate import within_noise
from massprops.diagnosis.diagnose import BalanceDiagnosis, diagnose_by_balance
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.measured_beside import effects_beside
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.search import diagnose
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.diagnosis.unnamed import without_effects
from massprops.diagnosis.verdict import significance
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import from_rotation_vector, multiply
from massprops.dynamics.rotation import trajectory
from massprops.effect_contract import faults
from massprops.effects import effects, of_record
from massprops.errors import InputError
from massprops.model import Model, document_of, load_model
from massprops.sequence import read_sequence, write_sequence
from massprops.sequence.data import AttitudeSeries, Environment, RangeSeries, RotorSeries, Sequence

INERTIA = np.diag([0.8, 1.0, 1.2])
MOMENTUM = np.array([0.04, -0.02, 0.05])
SIGMA = 1e-3


def spun(axis: np.ndarray | None = None) -> Sequence:
    """Attitudes of a body whose wheel runs up to 200 rad/s between 40 and 60 s, and the wheel's rate at other times."""
    times, own = np.arange(0.0, 120.0, 0.5), np.arange(-1.0, 122.0, 0.35)
    rate = 200.0 * np.clip((own - 40.0) / 20.0, 0.0, 1.0)
    given = {"times_s": own.tolist(), "rate_rad_s": rate.tolist()}
    wheel = of_record(effects()["internal-rotor"], given)
    model = Model((wheel,), (MOMENTUM,))
    moved = trajectory(
        times, np.array([1.0, 0, 0, 0]), np.array([0.1, 0.15, -0.08]), INERTIA, model.active, MOMENTUM, EnvironmentModel(Environment())
    )  # fmt: skip
    noise = SIGMA * np.random.default_rng(0).standard_normal((len(times), 3))
    q = multiply(moved.q, from_rotation_vector(noise))
    first = 2 * 10**9
    return Sequence(
        attitude=AttitudeSeries(first + np.round(times * 1e9).astype(np.int64), q, np.full(len(times), SIGMA)),
        rotor=RotorSeries(first + np.round(own * 1e9).astype(np.int64), rate, axis, 0.05),
    )


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[BalanceDiagnosis, Path]:
    folder = tmp_path_factory.mktemp("wheel")
    write_sequence(folder / "seq", spun())
    diagnosis = diagnose(folder / "seq", folder / "out")
    assert isinstance(diagnosis, BalanceDiagnosis)
    return diagnosis, folder


def test_it_is_named_with_a_number_for_each_axis(found: tuple[BalanceDiagnosis, Path]) -> None:
    document = found[0].document
    (effect,) = document["effects"]
    assert document["verdict"] == "named" and effect["name"] == "internal-rotor"
    value = np.array([effect["parameters"][f"momentum_{a}"] for a in "xyz"])
    sigma = np.array([effect["sigma"][f"momentum_{a}"] for a in "xyz"])
    assert len(effect["parameters"]) == 3 and (np.abs(value - MOMENTUM) < 4.0 * sigma).all()
    assert np.linalg.norm(value - MOMENTUM) < 0.03 * np.linalg.norm(MOMENTUM)


def test_its_moment_gives_that_of_the_body_in_si_units(found: tuple[BalanceDiagnosis, Path]) -> None:
    mean = found[0].document["effects"][0]["mean_moment_kg_m2"]
    assert mean["value"] == pytest.approx(0.05 * 200.0 / np.linalg.norm(MOMENTUM), abs=4.0 * mean["sigma"])


def test_the_model_that_is_written_holds_the_rate(found: tuple[BalanceDiagnosis, Path]) -> None:
    model = load_model(found[1] / "out" / "model.yaml")
    assert model.inertia is not None and model.rate is not None and model.attitude is not None
    times = np.arange(0.0, 120.0, 0.5)
    moved = trajectory(
        times,
        model.attitude,
        model.rate,
        model.inertia,
        model.active,
        model.flat(True),
        EnvironmentModel(Environment()),
    )
    series = spun().attitude
    assert series is not None
    cosine = np.abs(np.sum(moved.q * series.q, axis=1))
    assert np.sqrt(np.mean((2.0 * np.arccos(np.minimum(cosine, 1.0))) ** 2)) < 2.0 * SIGMA
    assert document_of(model)["effects"][0]["given"]["rate_rad_s"][-1] == pytest.approx(200.0)


def test_a_known_axis_leaves_one_number() -> None:
    along = MOMENTUM / np.linalg.norm(MOMENTUM)
    (wheel,) = effects_beside(spun(along))
    assert [q.name for q in wheel.PARAMETERS] == ["momentum"]
    np.testing.assert_allclose(wheel.internal(100.0, (), [0.5]), 0.5 * along)
    assert faults(wheel) == ""


def test_beside_an_unknown_torque_it_is_asked_whatever_leads(
    found: tuple[BalanceDiagnosis, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    (wheel,) = effects_beside(spun())
    monkeypatch.setattr(selection, "BESIDE_UNKNOWN", 0)
    monkeypatch.setattr(selection, "usable_effects", lambda record: ([effects()["constant-body-torque"], wheel], {}))
    tried = {c.name: c.with_latent for c in selection.select(found[0].record).tried}
    assert tried["internal-rotor"] is not None and tried["constant-body-torque"] is None


def test_times_count_from_ranges_that_begin_before() -> None:
    whole = spun()
    assert whole.attitude is not None
    first = int(whole.attitude.timestamp_ns[0]) - 20 * 10**9
    ranged = replace(whole, range=RangeSeries(first + 10**9 * np.arange(30), np.full(30, 9.0)))
    record = record_of_sequence(ranged)
    assert ranged.first_ns == first and record.times[0] == 20.0 and record.stamp[0] == whole.attitude.timestamp_ns[0]
    (wheel,) = effects_beside(ranged)
    fit = best_fit(record, wheel, without_effects(record)[0])
    assert fit is not None and within_noise(fit)


def test_its_rate_must_reach_over_the_record() -> None:
    whole = spun()
    assert whole.rotor is not None
    short = replace(whole.rotor, timestamp_ns=whole.rotor.timestamp_ns[:200], rate=whole.rotor.rate[:200])
    with pytest.raises(InputError, match="rotor0 reaches from -1 to 68.65 s and the record from 0 to 119.5 s"):
        diagnose_by_balance(replace(whole, rotor=short))
    still = replace(whole.rotor, rate=0.0 * whole.rotor.rate)
    with pytest.raises(InputError, match="shows no turning wheel in this record"):
        diagnose_by_balance(replace(whole, rotor=still))
    one = replace(whole.rotor, timestamp_ns=whole.rotor.timestamp_ns[:1], rate=whole.rotor.rate[:1])
    with pytest.raises(InputError, match="rotor0 holds 1 rates"):
        diagnose_by_balance(replace(whole, rotor=one))
    assert not hasattr(effects()["internal-rotor"], "GIVEN")


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("sensor.yaml", "axis: [0, 0, 0]\n", "axis has no length"),
        ("sensor.yaml", "inertia_kg_m2: -1\n", "inertia_kg_m2"),
        ("data.csv", "#timestamp [ns],rate [m]\n1,2\n", "rate"),
        ("data.csv", "#timestamp [ns],speed [rad s^-1]\n1,2\n", "no column rate"),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, file: str, text: str, says: str) -> None:
    write_sequence(tmp_path, spun())
    (tmp_path / "rotor0" / file).write_text(text)
    with pytest.raises(InputError, match=says):
        read_sequence(tmp_path)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("{times_s: [0, 1], rate_rad_s: [1]}", "times_s that rise"),
        ("{times_s: [0, 1]}", "rate_rad_s"),
        ("{times_s: [0, 1], rate_rad_s: [0, 0]}", "not all zero"),
    ],
)
def test_a_model_with_a_rate_that_is_none(tmp_path: Path, given: str, says: str) -> None:
    path = tmp_path / "model.yaml"
    path.write_text(
        "format: massprops-model/1\neffects:\n- {name: internal-rotor, parameters: {momentum_x: 0, momentum_y: 0, momentum_z: 1}, "
        f"given: {given}}}\n"
    )
    with pytest.raises(InputError, match=says):
        load_model(path)


def test_a_wheel_in_basilisk_whose_rate_is_known() -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import recorded

    sequence = recorded("internal-rotor", 1)
    assert sequence.attitude is not None
    stamp = sequence.attitude.timestamp_ns
    # a motor whose torque is constant from 300 to 600 s
    rate = (
        100.0
        + 0.5 * np.clip(stamp * 1e-9 - 300.0, 0.0, 300.0)
        + 0.3 * np.random.default_rng(1).standard_normal(len(stamp))
    )
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, _ = without_effects(record)
    (wheel,) = effects_beside(replace(sequence, rotor=RotorSeries(stamp, rate)))
    fit = best_fit(record, wheel, base)
    assert fit is not None and within_noise(fit) and not within_noise(base)
    assert significance(fit) < 1e-9 and len(fit.values["internal-rotor"]) == 3
