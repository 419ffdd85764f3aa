"""Sensors whose axes turn in the body from record to record: several records of one body with such a turn as an unknown."""

from __future__ import annotations

import json

import numpy as np
import pytest
from diagnosis.test_momentum_balance import INERTIA
from scipy.integrate import solve_ivp

from massprops.diagnosis import selection
from massprops.diagnosis.candidate import Candidate
from massprops.diagnosis.common_parameters import Common, common_of
from massprops.diagnosis.momentum_balance import Balance
from massprops.diagnosis.record import Record, attitudes_of, in_turned_axes, record_of_attitudes, record_of_rates
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import (
    chained,
    conjugate,
    from_rotation_vector,
    multiply,
    rotation_matrix,
    rotation_vector,
)
from massprops.errors import NotPossible
from massprops.sequence.data import AttitudeSeries, Environment, RateSeries, Sequence

SLIP = np.array([0.03, -0.02, 0.05])
STARTS = np.array([[4.0, -6.0, 5.0], [-5.0, 2.0, 7.0], [1.0, 8.0, 2.0]])
TURNED = 2e-3
SHOWN = 3e-3
FINE, COUNT, GAP = 20, 80, 0.0125
KINDS = ("rates", "attitudes", "both")


def seen(kind: str, turn: np.ndarray, seed: int = 0, drag: float = 0.0, speed: float = 1.0) -> Sequence:
    """A tumble as a sensor sees it whose axes are turned in the body; drag: over the mean moment [1/s], speed: factor on all rates."""

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        w = np.linalg.solve(INERTIA, y)
        return np.asarray(np.cross(y, w) - drag * w)

    t = GAP / FINE * np.arange(FINE * (COUNT - 1) + 1)
    y = solve_ivp(
        slope, (0.0, t[-1]), speed * INERTIA @ STARTS[seed], t_eval=t, rtol=1e-9, atol=1e-10, max_step=0.005
    ).y.T
    w = np.linalg.solve(INERTIA, y.T).T
    q = chained(0.5 * (w[1:] + w[:-1]) * np.diff(t)[:, None])[::FINE]
    rng = np.random.default_rng([seed, 9])
    stamp = np.round(t[::FINE] * 1e9).astype(np.int64)
    shown = w[::FINE] @ rotation_matrix(from_rotation_vector(turn)).T + SHOWN * rng.standard_normal((COUNT, 3))
    noise = from_rotation_vector(TURNED * rng.standard_normal((COUNT, 3)))
    turned = multiply(multiply(q, from_rotation_vector(-turn)), noise)
    return Sequence(
        rates=None if kind == "attitudes" else RateSeries(stamp, shown, SHOWN),
        attitude=None if kind == "rates" else AttitudeSeries(stamp, turned, np.full(COUNT, TURNED)),
    )


def _record(kind: str, turn: np.ndarray, seed: int = 0) -> Record:
    of = seen(kind, turn, seed)
    if of.attitude is None:
        assert of.rates is not None
        return record_of_rates(of.rates)
    return record_of_attitudes(of.attitude, Environment(), of.rates)


def _common(kind: str, turns: list[np.ndarray]) -> tuple[Common, Common]:
    """What records say together with one set of axes, and with axes that turn."""
    fits = [without_effects(_record(kind, t, k))[0] for k, t in enumerate(turns)]
    return common_of(fits), common_of(fits, axes=True)


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_is_told_in_other_axes(kind: str) -> None:
    straight, back = _record(kind, np.zeros(3)), in_turned_axes(_record(kind, SLIP), SLIP)
    assert back.path.w == pytest.approx(straight.path.w, abs=20.0 * SHOWN)
    if kind != "rates":
        off = rotation_vector(multiply(conjugate(attitudes_of(straight)), attitudes_of(back)))
        assert np.abs(off).max() < 6.0 * TURNED * np.linalg.norm(SLIP)
    if kind != "attitudes":
        own = [r.rows if kind == "rates" else r.rows.gyroscope for r in (straight, back)]
        assert own[0].measured == pytest.approx(own[1].measured, abs=6.0 * SHOWN * np.linalg.norm(SLIP))


@pytest.mark.parametrize("kind", KINDS)
def test_the_rows_of_a_turn_are_what_a_turned_sensor_shows(kind: str) -> None:
    fit = without_effects(_record(kind, np.zeros(3)))[0]
    balance = Balance(path=fit.record.path, shape=fit.shape, momentum=fit.carried, rate=fit.rate, rows=fit.record.rows)
    C = rotation_matrix(from_rotation_vector(1e-5 * SLIP))
    shown = fit.rate @ C.T - fit.rate
    if kind == "rates":
        # in a path that is integrated from what is shown the same momentum stands turned
        shown = shown - np.linalg.solve(fit.inertia, (fit.carried @ C.T - fit.carried).T).T
    expected = shown[fit.record.rows.at] if kind == "rates" else np.tile(-1e-5 * SLIP, (COUNT, 1))
    if kind == "both":
        expected = np.concatenate([expected, shown[fit.record.rows.gyroscope.at]])
    assert balance.axes() @ (1e-5 * SLIP) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_a_turn_between_records_is_found_with_a_sigma(kind: str) -> None:
    other = np.array([-0.02, 0.04, 0.01])
    same, turned = _common(kind, [np.zeros(3), SLIP, other])
    assert turned.evidence > same.evidence + 20.0 and turned.turns is not None
    pulls = (turned.turns.at[1:] - [SLIP, other]) / turned.turns.sigma[1:]
    assert np.abs(pulls).max() < 3.5 and turned.turns.sigma[1:].max() < 0.02
    assert (turned.turns.at[0] == 0.0).all() and (turned.turns.sigma[0] == 0.0).all()
    assert np.abs(turned.inertia - INERTIA).max() < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_sensors_that_stay_are_not_turned(kind: str) -> None:
    same, turned = _common(kind, [np.zeros(3)] * 3)
    assert turned.evidence < same.evidence + 3.0 and turned.turns is not None
    assert (np.abs(turned.turns.at[1:]) < 3.0 * turned.turns.sigma[1:]).all()


def _none(record: Record) -> Candidate:
    raise NotPossible("not tried")


def test_the_command_names_one_drag_in_records_of_a_sensor_that_slipped(
    tmp_path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    from massprops.sequence.write import write_sequence
    from massprops_cli.main import run

    usable = selection.usable_effects
    monkeypatch.setattr(
        selection, "usable_effects", lambda r: ([e for e in usable(r)[0] if e.NAME == "viscous-damping"], {})
    )
    monkeypatch.setattr(selection, "first_look_at_wheel", _none)
    for k, turn in enumerate((np.zeros(3), SLIP)):
        write_sequence(tmp_path / str(k), seen("rates", turn, k, drag=0.5))
    out = tmp_path / "out"
    assert run(["diagnose", str(tmp_path / "0"), str(tmp_path / "1"), "-o", str(out), "-q"]) == 0
    said = capsys.readouterr()
    document = json.loads((out / "diagnosis.json").read_text())
    assert document["verdict"] == "named" and document["effects"][0]["name"] == "viscous-damping"
    (turned,) = document["turned"]
    assert turned["record"] == str(tmp_path / "1")
    assert (np.abs(np.array(turned["turn_rad"]) - SLIP) < 3.5 * np.array(turned["sigma"])).all()
    assert "slipped or was mounted anew" in said.err and "turned by" in said.out
    assert abs(document["k1"]["value"] - ratios(INERTIA)[0][0]) < 4.0 * document["k1"]["sigma"] + 0.005
    assert not any(n["name"].startswith("axis_turn") for n in document["shared"])
