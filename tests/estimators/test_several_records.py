"""Ratios of inertia from several records of one body."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import massprops
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
