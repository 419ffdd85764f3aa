"""The papers' files keep their contract, and `reproduce` prints their tables."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from massprops.campaigns.configuration import plan_of
from massprops.campaigns.kinds import paper as kind
from massprops.campaigns.papers import load_paper, papers
from massprops.campaigns.reproduce import reproduce_plan
from massprops.campaigns.store import Row
from massprops.campaigns.table import Point
from massprops.errors import InputError
from massprops_cli.main import run

NAMES = papers()


def _configuration(case: str) -> dict[str, Any]:
    return {"case": case, "noise": {"px": 0.5, "rate": [1.0, 2.0]}, "steps": 100, "filter": "iekf", "extra": None}


FAKE = SimpleNamespace(
    PAPER="someone2001",
    CASES={"A": "slow", "B": "fast"},
    RUNS={"A": 12, "B": 7},
    CHUNK=5,
    BOXES={"A": ["error"], "B": ["other"]},
    configuration=_configuration,
    runs=lambda c, seeds: [{"seed": s, "error_px": s * c["noise"]["px"]} for s in seeds],
    table=lambda case, rows: {
        "title": f"Table {case}",
        "columns": ["n"],
        "rows": [[len(rows)]],
        "notes": ["as printed"],
    },
    speed=lambda: {"us_per_step": 12.5},
)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    import massprops.campaigns.papers as every
    import massprops.campaigns.reproduce as reproduce

    for module in (every, kind, reproduce):
        monkeypatch.setattr(module, "load_paper", lambda name: FAKE)
    return FAKE


def test_a_paper_is_a_campaign_over_its_cases(fake: SimpleNamespace) -> None:
    plan = reproduce_plan("someone2001")
    assert plan.grid == {"case": ["A", "B"]} and plan.total == 19 and plan.chunk == 5
    assert [len(c.seeds) for c in plan.chunks()] == [5, 5, 2, 5, 2]
    assert reproduce_plan("someone2001", "B", runs=3, seed=4).total == 3
    points = [
        Point(0, {"case": "A"}, {"paper": "someone2001", "case": "A"}, [Row(0, 1, {}, "bad"), Row(0, 2, {"x": 1})])
    ]
    assert kind.tables(plan, points) == [
        {"case": "A", "title": "Table A", "columns": ["n"], "rows": [[2]], "notes": ["as printed"]}
    ]
    assert kind.boxes(plan) == ["error", "other"]
    with pytest.raises(InputError, match="did you mean 'A'"):
        reproduce_plan("someone2001", "a")


def test_a_published_set_up_can_be_changed_by_name(fake: SimpleNamespace) -> None:
    base = {"kind": "paper", "paper": "someone2001", "case": "A"}
    plan = plan_of({**base, "grid": {"noise.px": [0.1, 1]}, "draw": {"steps": {"integer": [10, 20]}}})
    assert plan.points == 2 and plan.total == 24
    assert kind.set_up({"paper": "someone2001", "case": "A", "noise.px": 3.0})["noise"] == {
        "px": 3.0,
        "rate": [1.0, 2.0],
    }
    assert kind.runs({"paper": "someone2001", "case": "A", "noise.px": 3.0}, [2], None) == [
        {"seed": 2, "error_px": 6.0}
    ]
    assert plan.digest != plan_of({**base, "grid": {"noise.px": [0.1, 2]}, "draw": plan.draw}).digest
    for wrong, says in (
        ({"noise.pixels": 2}, "did you mean 'noise.px'"),
        ({"stps": 2}, "did you mean 'steps'"),
        ({"steps": "many"}, "give a number"),
        ({"noise": 2}, "names with values"),
        ({"case": "C"}, "no case"),
    ):
        with pytest.raises(InputError, match=says):
            plan_of({**base, **wrong})


def test_the_hash_covers_the_papers_set_up(fake: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    before = reproduce_plan("someone2001", "A").digest
    monkeypatch.setattr(FAKE, "configuration", lambda case: {**_configuration(case), "steps": 99})
    assert reproduce_plan("someone2001", "A").digest != before


def test_speed_is_printed_as_json(fake: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "someone2001", "speed", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"us_per_step": 12.5}
    assert run(["reproduce", "someone2001", "speed"]) == 0
    assert "us_per_step: 12.5" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["pesce17"], "did you mean 'pesce2017'"),
        (["pesce2017", "Z9"], "no case of pesce2017"),
        (["pesce2017", "--runs", "0"], "runs must be from 1"),
    ],
)
def test_wrong_papers_and_cases(capsys: pytest.CaptureFixture[str], arguments: list[str], says: str) -> None:
    assert run(["reproduce", *arguments]) == 2
    said = capsys.readouterr().err
    assert says in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize("name", NAMES)
def test_every_paper_keeps_the_contract(name: str) -> None:
    paper = load_paper(name)
    assert name == paper.PAPER and set(paper.RUNS) == set(paper.CASES)
    for case, sentence in paper.CASES.items():
        configuration = paper.configuration(case)
        assert json.loads(json.dumps(configuration, allow_nan=False)) == configuration, case
        assert sentence and paper.RUNS[case] >= 1
        plan = reproduce_plan(name, case)
        assert plan.total == paper.RUNS[case]


def test_reproduce_prints_ours_beside_the_papers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "pesce2017", "C", "--runs", "6", "-o", str(tmp_path / "a"), "--workers", "1", "-q"]) == 0
    text = capsys.readouterr().out
    assert "paper" in text
    command = [
        "reproduce",
        "pesce2017",
        "C",
        "--runs",
        "6",
        "-o",
        str(tmp_path / "b"),
        "--workers",
        "2",
        "-q",
        "--json",
    ]
    assert run(command) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((tmp_path / "a/table.json").read_text())
    assert document["done"] == 6 and document["tables"][0]["rows"]
    assert run(["reproduce", "pesce2017", "C", "--only", "3", "--json", "--workers", "1"]) == 0
    (alone,) = json.loads(capsys.readouterr().out)
    header, *lines = (tmp_path / "a/runs.csv").read_text().splitlines()
    stored = dict(zip(header.split(","), lines[3].split(","), strict=True))
    # among others, BLAS may round otherwise: an iterated update ends within 0.01 sigma of its answer
    same = pytest.approx(float(stored["k1"]), abs=0.01 * alone["sigma_k1"])
    assert alone["k1"] == same, "a run alone is the run among others"
