"""Ratios of inertia from several records of one body."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import massprops
from massprops.dynamics.inertia import ratios
from massprops.errors import NotPossible
from massprops.estimators.result import Estimate
from massprops.estimators.several import together
from massprops.sequence import write_sequence
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks
from massprops_cli.main import run

RATES = {"features": 0, "rate_sigma": 3e-4, "range_sigma_m": 0.0, "frames": 120}


def outcome(k1: float, sd: float, name: str = "smoother") -> Any:
    one = Estimate(name, True, True, k1=k1, k2=-0.2, k_covariance=np.diag([sd**2, 1e-4]))
    return SimpleNamespace(sound=[one])


def test_laws_are_joined_as_their_product() -> None:
    (found,) = together({"a": outcome(-0.30, 0.01), "b": outcome(-0.33, 0.02)})
    assert found.k == pytest.approx([-0.306, -0.2]) and found.records == ("a", "b")
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([0.01 * np.sqrt(0.8), 0.01 * np.sqrt(0.5)])
    # 0.03 apart with sigmas of 0.01 and 0.02: a square of 1.8 over two degrees of freedom
    assert found.p_value == pytest.approx(np.exp(-0.9))


def test_bodies_that_differ_and_single_records_are_refused() -> None:
    with pytest.raises(NotPossible, match="different bodies"):
        together({"a": outcome(-0.30, 0.01), "b": outcome(-0.45, 0.02)})
    with pytest.raises(NotPossible, match="reliable in two"):
        together({"a": outcome(-0.30, 0.01), "b": outcome(-0.30, 0.01, "ekf")})


def test_the_command_joins_records_and_writes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, rate in (("slow", 5.0), ("fast", 7.0)):
        made = simulate_tracks(TrackScenario(**RATES, rate_deg=rate, seed=1))
        write_sequence(tmp_path / name, made.sequence)
    own = [str(tmp_path / name) for name in ("slow", "fast")]
    assert run(["estimate", *own, "--method", "momentum-ls", "-o", str(tmp_path / "out"), "-q"]) == 0
    assert "p of one body" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "estimates.json").read_text())
    (joint,) = document["estimators"]
    assert set(document["records"]) == set(own) and joint["records"] == own
    assert abs(joint["k1"] - made.truth["k1"]) < 4 * joint["sigma_k1"]
    alone = [d["estimators"][0]["sigma_k1"] for d in document["records"].values()]
    assert joint["sigma_k1"] < min(alone)
    found = massprops.estimate(own[0], more=own[1:], method="momentum-ls")
    assert found.k1 == pytest.approx(joint["k1"]) and found.verdict == "observable"


MOMENTS = ("moment_x", "moment_y", "moment_z")


def wheeled(k1: float, moment: float, rho: float) -> Any:
    """An estimate of a wheel's moment whose error goes with that of k1."""
    whole = np.diag([1e-4, 1e-4, 1e-4])
    whole[0, 2] = whole[2, 0] = rho * 1e-4
    one = Estimate(
        "smoother", True, True, k1=k1, k2=-0.2, k_covariance=whole[:2, :2], body_frame="attitude0",
        of_body={("internal-rotor", "moment"): moment}, whole_covariance=whole,
    )  # fmt: skip
    return SimpleNamespace(sound=[one])


def test_a_number_of_the_body_that_both_find_helps_the_ratios() -> None:
    """Errors that go together in opposite senses leave less of both than the ratios alone."""
    (found,) = together({"a": wheeled(-0.30, 0.5, 0.95), "b": wheeled(-0.30, 0.5, -0.95)})
    assert found.parameters["internal-rotor"]["moment"] == pytest.approx(0.5)
    assert (
        np.sqrt(found.covariance[0, 0]) < 0.5 * 0.01 / np.sqrt(2.0) and found.sigma["internal-rotor"]["moment"] < 0.004
    )


def test_different_wheels_leave_the_ratios() -> None:
    (found,) = together({"a": wheeled(-0.30, 0.5, 0.3), "b": wheeled(-0.30, 0.7, 0.3)})
    assert found.differ and not found.parameters and found.k[0] == pytest.approx(-0.30)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.01 / np.sqrt(2.0))


def test_the_smoother_finds_one_wheel_in_two_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from diagnosis.test_several_wheels import INERTIA, MOMENT, down, spun, up

    for name, sequence in (("up", spun(up, [0.1, 0.15, -0.08], 0)), ("down", spun(down, [0.05, -0.1, 0.12], 1))):
        write_sequence(tmp_path / name, sequence)
    own = [str(tmp_path / name) for name in ("up", "down")]
    assert run(["estimate", *own, "--method", "smoother", "-o", str(tmp_path / "out"), "-q"]) == 0
    assert "moment_x of internal-rotor" in capsys.readouterr().out
    (found,) = json.loads((tmp_path / "out" / "estimates.json").read_text())["estimators"]
    assert found["p_value"] > 1e-3
    for name, truth in zip(MOMENTS, MOMENT, strict=True):
        value, sigma = (found[k]["internal-rotor"][name] for k in ("parameters", "sigma"))
        assert value == pytest.approx(truth, abs=4.0 * sigma) and sigma < 1e-6
    for k, truth in zip(("k1", "k2"), ratios(INERTIA)[0], strict=True):
        assert found[k] == pytest.approx(truth, abs=4.0 * found[f"sigma_{k}"])
