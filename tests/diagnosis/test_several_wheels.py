"""Several records of one body with a wheel whose rate was measured in each: one moment of inertia of the wheel."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from massprops.diagnosis import selection
from massprops.diagnosis.candidate import within_noise
from massprops.diagnosis.common_parameters import common_of
from massprops.diagnosis.diagnose import diagnose_by_balance, diagnose_several
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.measured_beside import effects_beside, of_one_wheel
from massprops.diagnosis.momentum_balance import shape_of
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.record_agreement import OF_INERTIA, own_numbers, shared_numbers, stretch
from massprops.diagnosis.several import _apart
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import from_rotation_vector, multiply
from massprops.dynamics.rotation import trajectory
from massprops.effects import effects, of_record
from massprops.errors import InputError
from massprops.model import Model
from massprops.sequence.data import AttitudeSeries, Environment, RotorSeries, Sequence

INERTIA = np.diag([0.8, 1.0, 1.2])
MOMENT = np.array([2e-4, -1e-4, 2.5e-4])
"""Of the wheel, along each axis, over the body's mean moment."""
NAMES = ("moment_x", "moment_y", "moment_z")
FIRST_NS = 2 * 10**9


def up(t: np.ndarray) -> np.ndarray:
    return np.asarray(200.0 * np.clip((t - 40.0) / 20.0, 0.0, 1.0))


def down(t: np.ndarray) -> np.ndarray:
    return np.asarray(-80.0 * np.clip((70.0 - t) / 30.0, 0.0, 1.0))


def steady(t: np.ndarray) -> np.ndarray:
    return 150.0 + 0.0 * t


def spun(
    rate: Callable[[np.ndarray], np.ndarray],
    start: list[float],
    seed: int,
    moment: np.ndarray = MOMENT,
    sigma: float = 1e-3,
) -> Sequence:
    """Attitudes of a body that begins at rates [rad/s], whose wheel turns at `rate`, and that rate at other times."""
    times, own = np.arange(0.0, 120.0, 0.5), np.arange(-1.0, 122.0, 0.35)
    wheel = of_record(effects()["internal-rotor"], {"times_s": own.tolist(), "rate_rad_s": rate(own).tolist()})
    momentum = moment * np.abs(rate(own)).max()
    model = Model((wheel,), (momentum,))
    moved = trajectory(
        times, np.array([1.0, 0, 0, 0]), np.array(start), INERTIA, model.active, momentum, EnvironmentModel(Environment())
    )  # fmt: skip
    noise = sigma * np.random.default_rng(seed).standard_normal((len(times), 3))
    stamp = FIRST_NS + np.round(times * 1e9).astype(np.int64)
    return Sequence(
        attitude=AttitudeSeries(stamp, multiply(moved.q, from_rotation_vector(noise)), np.full(len(times), sigma)),
        rotor=RotorSeries(FIRST_NS + np.round(own * 1e9).astype(np.int64), rate(own), None, 0.05),
    )


def fitted(sequence: Sequence) -> HypothesisFit:
    """The wheel by itself."""
    assert sequence.attitude is not None
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    fit = best_fit(record, effects_beside(sequence)[0], without_effects(record)[0])
    assert fit is not None and within_noise(fit)
    return fit


@cache
def begun(seed: int, sigma: float = 3e-3) -> tuple[HypothesisFit, HypothesisFit]:
    """A wheel that runs up in one record and turns evenly in another."""
    rng = np.random.default_rng([seed, 9])
    starts = [rng.normal(0.0, 0.1, 3).tolist() for _ in range(2)]
    return (
        fitted(spun(up, starts[0], 100 + seed, sigma=sigma)),
        fitted(spun(steady, starts[1], 200 + seed, sigma=sigma)),
    )


def test_its_moment_comes_closer_than_from_either_record() -> None:
    fits = begun(0)
    found = common_of(list(fits))
    value = np.array([found.parameters["internal-rotor"][n] for n in NAMES])
    sigma = np.array([found.sigma["internal-rotor"][n] for n in NAMES])
    # momenta at the largest rate, of 200 and 150 rad/s
    alone = [
        np.sqrt(np.diag(f.covariance["internal-rotor"])) / rate for f, rate in zip(fits, (200.0, 150.0), strict=True)
    ]
    assert (sigma < 0.7 * np.minimum(*alone)).all()
    assert (np.abs(value - MOMENT) < 4.0 * sigma).all()
    apart = common_of([_apart(f) for f in fits])
    assert apart.parameters == {"internal-rotor": {}} and found.evidence > apart.evidence + 10.0


def test_its_sigmas_are_those_of_the_errors() -> None:
    """Over eight pairs of records: the sum of squares of inertia and moment by their joint covariance, of eight degrees of freedom."""
    truth = np.concatenate([shape_of(INERTIA), MOMENT])
    squares = []
    for seed in range(8):
        law = common_of(list(begun(seed))).law
        assert law is not None
        squares.append((law.mean - truth) @ np.linalg.solve(law.covariance, law.mean - truth))
    # chi-square of 64 degrees of freedom: 37 to 100 in all but one of a thousand
    assert 37.0 < sum(squares) < 100.0


def test_records_of_one_body_agree_and_moved_ones_do_not() -> None:
    found = common_of(list(begun(1)))
    assert stretch(found) == 1.0 and not any(n.differs for n in shared_numbers(found))
    assert [n.name for n in shared_numbers(found)] == [*OF_INERTIA, *NAMES]
    law = found.records[0]
    mean = law.mean.copy()
    mean[-1] += 8.0 * np.sqrt(law.covariance[-1, -1])
    moved = replace(found, records=(replace(law, mean=mean), found.records[1]))
    assert stretch(moved) > 1.5


def test_rows_that_are_alike_count_by_as_much_less() -> None:
    """A fit that is told with sigmas three times as large, because its residuals are alike in neighbours, is so among others as well."""
    fits = list(begun(2))
    plain, wide = common_of(fits), common_of([replace(f, widened=3.0) for f in fits])
    for name in NAMES:
        assert wide.sigma["internal-rotor"][name] == pytest.approx(3.0 * plain.sigma["internal-rotor"][name], rel=0.1)


def test_a_record_without_the_wheel_says_nothing_of_it() -> None:
    fit, _ = begun(3)
    record = spun(lambda t: 0.0 * t + 1e-9, [0.05, -0.1, 0.12], 3)
    assert record.attitude is not None
    base, _ = without_effects(record_of_attitudes(record.attitude, record.environment))
    found = common_of([fit, base])
    own = common_of([fit])
    assert found.sigma["internal-rotor"]["moment_x"] < 1.001 * own.sigma["internal-rotor"]["moment_x"]
    assert np.abs(ratios(found.inertia)[0] - ratios(INERTIA)[0]).max() < 5e-3
    assert np.isfinite(next(n for n in shared_numbers(found) if n.name == "k1").values).all()
    assert all(n.effect == "" for n in shared_numbers(found))


def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the catalogue a wheel and a constant torque alone, for speed."""
    usable, few = selection.usable_effects, ("internal-rotor", "constant-body-torque")
    monkeypatch.setattr(selection, "usable_effects", lambda r: ([e for e in usable(r)[0] if e.NAME in few], {}))


def test_the_command_tells_the_moment_and_the_bodys_mean_moment(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from massprops.sequence import write_sequence
    from massprops_cli.main import run

    _few(monkeypatch)
    for name, sequence in (("up", spun(up, [0.1, 0.15, -0.08], 0)), ("down", spun(down, [0.05, -0.1, 0.12], 1))):
        write_sequence(tmp_path / name, sequence)
    own = [str(tmp_path / name) for name in ("up", "down")]
    assert run(["diagnose", *own, "-o", str(tmp_path / "out"), "-q"]) == 0
    assert "moment_z" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["verdict"] == "named" and "its parameters the same" in document["reason"]
    (effect,) = document["effects"]
    for name, truth in zip(NAMES, MOMENT, strict=True):
        told = effect["parameters"]["internal-rotor"][name], effect["sigma"]["internal-rotor"][name]
        assert told[0] == pytest.approx(truth, abs=4.0 * told[1])
    mean = effect["mean_moment_kg_m2"]
    alone = [d["effects"][0]["mean_moment_kg_m2"]["sigma"] for d in document["records"].values()]
    assert mean["value"] == pytest.approx(0.05 / np.linalg.norm(MOMENT), rel=1e-3) and mean["sigma"] < min(alone)
    assert all(len(n["values"]) == 2 and n["p_value"] > 1e-3 for n in document["shared"])


def test_another_wheel_in_another_record_is_told_and_leaves_the_inertia_common(monkeypatch: pytest.MonkeyPatch) -> None:
    _few(monkeypatch)
    records = {
        "one": spun(up, [0.1, 0.15, -0.08], 0),
        "other": spun(down, [0.05, -0.1, 0.12], 1, moment=1.5 * MOMENT),
    }
    document = diagnose_several(records)
    assert document["verdict"] == "named" and document["effects"][0]["parameters"] == {"internal-rotor": {}}
    (said,) = (w for w in document["warnings"] if "do not show one internal-rotor" in w)
    assert "moment_x" in said
    (told,) = (n for n in document["shared"] if n["name"] == "moment_x")
    assert told["values"] == pytest.approx([2e-4, 3e-4], rel=5e-3) and told["p_value"] < 1e-6
    for k, truth in zip(("k1", "k2"), ratios(INERTIA)[0], strict=True):
        assert document[k]["value"] == pytest.approx(truth, abs=4.0 * document[k]["sigma"])
    assert "mean_moment_kg_m2" not in document["effects"][0]


def test_a_wheel_too_slow_to_be_seen_follows_its_own_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a record that a free body explains the wheel is the one whose rate was measured there."""
    _few(monkeypatch)
    slow = spun(lambda t: 1e-3 * down(t), [0.05, -0.1, 0.12], 1)
    document = diagnose_several({"one": spun(up, [0.1, 0.15, -0.08], 0), "slow": slow})
    assert [d["verdict"] for d in document["records"].values()] == ["named", "none"]
    assert document["verdict"] == "named" and not document["warnings"]
    value, sigma = (document["effects"][0][k]["internal-rotor"]["moment_z"] for k in ("parameters", "sigma"))
    assert value == pytest.approx(MOMENT[2], abs=4.0 * sigma)


def test_what_one_record_states_of_the_wheel_holds_in_all() -> None:
    one, two, still = spun(up, [0.1, 0.15, -0.08], 0), spun(down, [0.05, -0.1, 0.12], 1), spun(up, [0.1, 0.0, 0.0], 2)
    axis = MOMENT / np.linalg.norm(MOMENT)
    assert one.rotor is not None and two.rotor is not None and still.rotor is not None
    known = replace(one, rotor=replace(one.rotor, axis=axis, inertia_kg_m2=None))
    rest = replace(still, rotor=replace(still.rotor, rate=0.0 * still.rotor.rate))
    out = of_one_wheel({"a": known, "b": two, "c": rest})
    assert (
        all(s.rotor is not None and s.rotor.inertia_kg_m2 == 0.05 for s in (out["a"], out["b"]))
        and out["c"].rotor is None
    )
    np.testing.assert_array_equal(out["b"].rotor.axis, axis)  # type: ignore[union-attr]
    turned = replace(two, rotor=replace(two.rotor, axis=np.array([0.0, 0.0, 1.0])))
    with pytest.raises(InputError, match="b: rotor0 states another axis"):
        of_one_wheel({"a": known, "b": turned})
    heavy = replace(two, rotor=replace(two.rotor, inertia_kg_m2=0.06))
    with pytest.raises(InputError, match="b: rotor0 states 0.06 kg m² and another record 0.05"):
        of_one_wheel({"a": one, "b": heavy})


def test_numbers_of_its_own_are_told_by_each_record() -> None:
    numbers = own_numbers(list(begun(4)))
    assert [n.name for n in numbers] == list(NAMES) and all(len(n.values) == 2 for n in numbers)


@pytest.mark.parametrize("record", ["config_c_LOG00164", "config_c_LOG00166"])
def test_a_column_is_the_rate_over_its_largest(real_data: Path, record: str) -> None:
    """Of a flight whose wheel runs up and is braked: the moment times the largest rate is the momentum there."""
    from massprops.sequence import read_sequence

    rate = np.loadtxt(real_data / "flights" / record / "truth" / "flywheel.csv", delimiter=",", comments="#")
    sequence = read_sequence(real_data / "flights" / record)
    (wheel,) = effects_beside(replace(sequence, rotor=RotorSeries(rate[:, 0].astype(np.int64), rate[:, 1])))
    t = np.asarray(wheel.GIVEN["times_s"])
    columns = wheel.momentum_columns(t, np.zeros((len(t), 3, 3)), np.zeros((len(t), 3)), None)["internal"]
    for k, (name, (word, largest)) in enumerate(wheel.BODY_NUMBERS.items()):
        assert (name, word) == (f"momentum_{'xyz'[k]}", f"moment_{'xyz'[k]}")
        np.testing.assert_allclose(largest * columns[:, k, k], wheel.GIVEN["rate_rad_s"])


def test_one_record_keeps_its_momentum_at_the_largest_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    _few(monkeypatch)
    (effect,) = diagnose_by_balance(spun(down, [0.05, -0.1, 0.12], 1)).document["effects"]
    assert effect["parameters"]["momentum_z"] == pytest.approx(80.0 * MOMENT[2], rel=1e-2)
