"""The cross-check's verdict in the confidence of a run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from massprops.consistency.trust import enter_verdict
from massprops.core.files import hash_tree, write_json
from massprops.core.outputs import Outputs, claim, verify
from massprops.mass.confidence import Evidence, ImageEvidence, SurfaceEvidence, confidence, lowered

VERDICTS = {v: {"verdict": v, "reason": "k1 differs"} for v in ("consistent", "inconsistent", "unobservable")}
GOOD = confidence(Evidence(SurfaceEvidence(0.03, 0.05, 0.0), ImageEvidence(40, 40)))
FAIR = confidence(Evidence(SurfaceEvidence(0.10, 0.05, 0.0), ImageEvidence(40, 40)))


def run_of(folder: Path, trust: dict | None) -> Outputs:
    """A run's record, its massprops.json published and the mass stage's own in work/mass."""
    document = {"volume": 1.0} if trust is None else {"volume": 1.0, "confidence": trust}
    (folder / "work" / "mass").mkdir(parents=True)
    write_json(folder / "work" / "mass" / "massprops.json", document)
    with claim(folder, "reconstruct", ["massprops.json", "mesh.ply"]) as outputs:
        outputs.record_tree("work/mass", "reconstruct", "m", hash_tree(folder / "work" / "mass"))
        new = outputs.staging()
        write_json(new / "massprops.json", document)
        (new / "mesh.ply").write_text("mesh")
        outputs.publish("reconstruct", "key")
    return Outputs(folder)


@pytest.mark.parametrize(("trust", "level"), [(GOOD, "medium"), (FAIR, "low")])
def test_a_contradiction_lowers_it_once_and_a_later_verdict_takes_it_back(
    tmp_path: Path, trust: dict, level: str
) -> None:
    outputs = run_of(tmp_path, trust)
    for _ in range(2):
        enter_verdict(outputs, VERDICTS["inconsistent"])
    found = json.loads((tmp_path / "massprops.json").read_text())
    assert found["confidence"]["level"] == level and found["volume"] == 1.0
    assert found["confidence"]["because"][0] == "shape and motion contradict each other: k1 differs"
    verify(tmp_path, "massprops.json", "mesh.ply")
    assert Outputs(tmp_path).complete("reconstruct", "key") and (tmp_path / "mesh.ply").read_text() == "mesh"
    enter_verdict(Outputs(tmp_path), VERDICTS["consistent"])
    assert json.loads((tmp_path / "massprops.json").read_text())["confidence"] == trust


def test_a_verdict_that_contradicts_nothing_changes_nothing(tmp_path: Path) -> None:
    outputs = run_of(tmp_path, GOOD)
    before = (tmp_path / "massprops.json").read_bytes()
    for verdict in ("consistent", "unobservable"):
        assert enter_verdict(outputs, VERDICTS[verdict]) == GOOD
    assert (tmp_path / "massprops.json").read_bytes() == before


def test_files_that_are_not_a_reconstructions_are_left_alone(tmp_path: Path) -> None:
    run_of(tmp_path / "none", None)
    assert enter_verdict(Outputs(tmp_path / "none"), VERDICTS["inconsistent"]) is None
    (tmp_path / "bare").mkdir()
    write_json(tmp_path / "bare" / "massprops.json", {"confidence": GOOD})
    assert enter_verdict(Outputs(tmp_path / "bare"), VERDICTS["inconsistent"]) is None


def test_a_good_word_is_no_reason_for_a_worse_one() -> None:
    assert lowered(GOOD, "x") == {"level": "medium", "because": ["x"]}
    assert lowered(FAIR, "x") == {"level": "low", "because": ["x", *FAIR["because"]]}
