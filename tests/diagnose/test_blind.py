"""Diagnosis as a command, in a folder that holds a sequence and nothing of the answer."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from diagnose.blind import hide, judge

from massprops.sequence import write_sequence
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

FRAMES = 160


def _diagnose(folder: Path, out: Path) -> dict:
    from massprops_cli.main import run

    assert run(["diagnose", str(folder), "-o", str(out), "-q"]) == 0
    return json.loads((out / "diagnosis.json").read_text())


@pytest.mark.parametrize("seed", range(1, 7))
def test_one_hidden_effect_is_named_or_the_base_model_suffices(tmp_path: Path, seed: int) -> None:
    hide(seed, tmp_path / "seq", tmp_path / "answer", FRAMES, "one")
    assert not list((tmp_path / "seq").glob("truth*"))
    document = _diagnose(tmp_path / "seq", tmp_path / "out")
    answer = json.loads((tmp_path / "answer" / "answer.json").read_text())
    result = judge(document, answer)
    if result["before"] > 1.15:
        assert result["listed"], result
        assert result["after"] < 1.15
    else:
        assert result["listed"] or document["verdict"] == "none", result


@pytest.mark.parametrize("seed", [21, 22])
def test_nothing_hidden_is_called_none(tmp_path: Path, seed: int) -> None:
    hide(seed, tmp_path / "seq", tmp_path / "answer", FRAMES, "none")
    assert _diagnose(tmp_path / "seq", tmp_path / "out")["verdict"] == "none"


@pytest.mark.parametrize("seed", [31])
def test_a_torque_outside_the_catalogue_is_not_misnamed(tmp_path: Path, seed: int) -> None:
    hide(seed, tmp_path / "seq", tmp_path / "answer", FRAMES, "outside")
    document = _diagnose(tmp_path / "seq", tmp_path / "out")
    assert document["verdict"] == "unexplained"
    assert document["torque"]["after"] < document["torque"]["before"]
    assert "torque" in (tmp_path / "out" / "residual.csv").read_text()


def test_two_hidden_effects_are_both_named(tmp_path: Path) -> None:
    """Each is large enough to show on its own: the pair drawn at random in the bench need not be."""
    names = ("viscous-damping", "focal-length-error")
    scenario = TrackScenario(frames=100, rate_deg=6.4, seed=41, effects=tuple(f"{n}:8" for n in names))
    write_sequence(tmp_path / "seq", simulate_tracks(scenario).sequence)
    document = _diagnose(tmp_path / "seq", tmp_path / "out")
    assert {e["name"] for e in document["effects"]} == set(names)
    assert document["gap"]["held_out"]["after"] < 1.1
