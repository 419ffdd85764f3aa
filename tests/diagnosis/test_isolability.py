"""A planned record: from what size an effect shows, what it is told apart from, and that both are so."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.design import design
from massprops.diagnosis.effect_columns import Term, forcing_of
from massprops.diagnosis.evidence import reduced
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.isolability import noncentrality, plan
from massprops.diagnosis.momentum_balance import Balance
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.effects import effects
from massprops.errors import InputError
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

SCENARIO = TrackScenario(frames=100, rate_deg=5.0, features=0, attitude_sigma=1e-3, range_sigma_m=0.0)


def signals(scenario: TrackScenario = SCENARIO, **environment: np.ndarray) -> dict:
    made = simulate_tracks(scenario)
    around = replace(made.sequence.environment, **environment)  # type: ignore[arg-type]
    found = plan(record_of_sequence(replace(made.sequence, environment=around)), made.state.inertia)
    return {"plan": found} | {s.name: s for s in found.signals}


def test_the_power_of_the_test_is_what_it_says() -> None:
    for unknowns in (1, 3, 6):
        assert abs(ncx2.sf(chi2.isf(1e-3, unknowns), unknowns, noncentrality(unknowns)) - 0.9) < 1e-6


def test_a_sensor_ten_times_better_shows_ten_times_less() -> None:
    rough, fine = signals(), signals(replace(SCENARIO, attitude_sigma=1e-4))
    for name in ("constant-body-torque", "viscous-damping", "solar-radiation-torque"):
        assert 8.0 < rough[name].shows_from / fine[name].shows_from < 12.0
        assert rough[name].best <= rough[name].shows_from <= rough[name].worst


def test_an_effect_shows_from_the_size_that_was_planned() -> None:
    """At three times that size, which is of a middling direction, the plain rigid body's fit betrays it nearly always, at a fifth of it hardly ever."""
    size = signals()["constant-body-torque"].shows_from
    term = Term(effect=effects()["constant-body-torque"])
    rng = np.random.default_rng(0)
    shown = {3.0: 0, 0.2: 0}
    for factor in shown:
        for seed in range(6):
            x = rng.normal(size=3)
            x *= factor * size / np.linalg.norm(x)
            torque = f"constant-body-torque:torque_x={x[0]},torque_y={x[1]},torque_z={x[2]}"
            made = simulate_tracks(replace(SCENARIO, effects=(torque,)))
            record = record_of_sequence(_other_noise(made.sequence, seed))
            base = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=made.state.inertia, left=1.0))
            shown[factor] += _score_test(base, term) < 1e-3
    assert shown[3.0] >= 5 and shown[0.2] <= 1, shown


def _score_test(base: HypothesisFit, term: Term) -> float:
    """Chance of rows that ask for a term as much as these do, when it does not act (Rao 1948)."""
    record = base.record
    balance = Balance(
        path=record.path, shape=base.shape, momentum=base.rate @ base.inertia, rate=base.rate, rows=record.rows
    )  # fmt: skip
    columns = balance.columns(forcing_of(term, record.path, base.rate, base.inertia, record.environment_state))
    over = 1.0 / np.repeat(record.rows.sigma, 3)
    fixed = np.concatenate([b.columns for b in base.blocks], axis=1)
    sd = np.concatenate([base.posterior.sd[b.name] for b in base.blocks])
    G, b = reduced(fixed, sd, columns.reshape(len(over), -1) * over[:, None], base.y)
    return float(chi2.sf(b @ np.linalg.solve(G, b), len(b)))


def _other_noise(sequence, seed: int):  # type: ignore[no-untyped-def]
    """The record with half as much noise again, of its own seed: the scenario's is the same in every run."""
    from massprops.dynamics.quaternion import from_rotation_vector, multiply

    series = sequence.attitude
    turn = 0.5 * series.sigma[:, None] * np.random.default_rng(seed).normal(size=(len(series.q), 3))
    q = multiply(series.q, from_rotation_vector(turn))
    return replace(sequence, attitude=replace(series, q=q, sigma=1.118 * series.sigma))


def test_what_looks_the_same_is_never_told_apart() -> None:
    along = np.array([0.6, 0.0, 0.8])
    found = signals(sun_direction=along, magnetic_field_T=3e-5 * along)
    pairs = found["plan"].confused
    assert ("solar-radiation-torque", "magnetic-dipole-torque") in pairs
    assert ("solar-radiation-torque", "constant-body-torque") not in pairs


def test_the_command_says_it_and_what_would_help(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text("kind: tracks\nframes: 40\nrate_deg: 3\nfeatures: 0\nrate_sigma: 1e-4\nrange_sigma_m: 0\n")
    command = [sys.executable, "-m", "massprops_cli.main", "diagnose"]
    done = subprocess.run(
        [*command, "--design", str(path), "-o", str(tmp_path / "out"), "--json"], capture_output=True, text=True, check=True
    )  # fmt: skip
    document = json.loads(done.stdout)
    assert document == json.loads((tmp_path / "out" / "design.json").read_text())
    assert document["measured"] == "body rates" and document["effects"] and document["confused"]
    assert any(change["tells_apart"] for change in document["would_help"])
    neither = subprocess.run(command, capture_output=True, text=True, check=False)
    assert neither.returncode == 2 and len(neither.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("text", ["asteroid", "absent.yaml"])
def test_what_is_no_plan_is_one_clear_line(text: str) -> None:
    with pytest.raises(InputError, match="give 'tracks', or a YAML file"):
        design(text)
