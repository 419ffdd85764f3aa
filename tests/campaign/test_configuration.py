"""What a campaign's file may say, and what is said to it when it is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from massprops.campaigns.configuration import check_size, plan_of, read_configuration
from massprops.campaigns.draws import drawn
from massprops.errors import InputError
from massprops_cli.main import run

DRILL: dict[str, Any] = {"kind": "drill", "runs": 7, "chunk": 3}


def test_grid_seeds_and_chunks() -> None:
    plan = plan_of({**DRILL, "seed": 5, "grid": {"sigma": [1, 2], "draws": [3, 4, 5]}})
    assert plan.points == 6 and plan.total == 42
    chunks = list(plan.chunks())
    assert [c.seeds for c in chunks[:3]] == [(5, 6, 7), (8, 9, 10), (11,)]
    assert [c.parameters for c in chunks[::3]][:2] == [{"sigma": 1, "draws": 3}, {"sigma": 1, "draws": 4}]
    assert len(chunks) == 18


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({}, "no kind"),
        ({"kind": "drll"}, "did you mean 'drill'"),
        ({**DRILL, "sigmaa": 2}, "no key 'sigmaa'; did you mean 'sigma'?"),
        ({**DRILL, "Runs": 2}, "did you mean 'runs'?"),
        ({**DRILL, "grid": {"sigmma": [2]}}, "did you mean 'sigma'?"),
        ({**DRILL, "draw": {"sgma": {"uniform": [0, 1]}}}, "did you mean 'sigma'?"),
        ({**DRILL, "limits": {"time": 2}}, "did you mean 'time_s'?"),
        ({**DRILL, "limits": {"time_s": -2}}, "time_s must be from"),
        ({**DRILL, "limits": 3}, "limits"),
        ({**DRILL, "sigma": "many"}, "sigma many"),
        ({**DRILL, "grid": {"sigma": []}}, "give a list"),
        ({**DRILL, "grid": {"sigma": 3}}, "give a list"),
        ({**DRILL, "grid": {"sigma": [1, -1]}}, "sigma -1"),
        ({**DRILL, "sigma": 1, "grid": {"sigma": [1]}}, "twice"),
        ({**DRILL, "draw": {"sigma": {"unifrom": [0, 1]}}}, "did you mean 'uniform'?"),
        ({**DRILL, "draw": {"sigma": {"uniform": [1, 0]}}}, "[low, high]"),
        ({**DRILL, "draw": {"sigma": {"uniform": [-5, 1]}}}, "sigma -5"),
        ({**DRILL, "draw": {"sigma": 5}}, "for example"),
        ({**DRILL, "runs": 0}, "runs must be from 1"),
        ({**DRILL, "runs": 2.5}, "whole"),
        ({**DRILL, "seed": -1}, "seed must be from 0"),
        ({**DRILL, "chunk": True}, "chunk must be a number, not True"),
        ({"kind": "paper"}, "no paper"),
        ({"kind": "paper", "paper": "nobody1999"}, "no paper 'nobody1999'"),
        ({"kind": "reconstruct"}, "no videos"),
        ({"kind": "reconstruct", "videos": ["nothing.mp4"]}, "no such file"),
    ],
)
def test_wrong_configurations_are_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: dict[str, Any], says: str
) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(content))
    assert run(["campaign", str(path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert len(said.err.strip().splitlines()) == 1 and says in said.err and not said.out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["kind: [", "- a\n- b", "", "kind: drill\ngrid: {1: [2]}"])
def test_files_that_are_no_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    (tmp_path / "study.yaml").write_text(text)
    assert run(["campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert run(["campaign", str(tmp_path / "none.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2


def test_more_than_a_million_runs_need_consent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = {"kind": "drill", "runs": 1000, "grid": {"sigma": list(range(1, 33)), "draws": list(range(1, 33))}}
    plan = plan_of(content)
    with pytest.raises(InputError, match="1024000 runs.*--yes"):
        check_size(plan, yes=False)
    check_size(plan, yes=True)
    check_size(plan_of({**content, "runs": 976}), yes=False)
    (tmp_path / "big.yaml").write_text(yaml.safe_dump(content))
    assert run(["campaign", str(tmp_path / "big.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert "--yes" in capsys.readouterr().err
    with pytest.raises(InputError, match="largest"):
        check_size(plan_of({**DRILL, "seed": 2**31 - 3}), yes=False)


def test_numbers_that_yaml_reads_as_text(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text("kind: drill\nsigma: 1e-3\ngrid: {draws: [1e1, 2E+1]}\n")
    plan = read_configuration(tmp_path / "study.yaml")
    assert plan.fixed["sigma"] == 1e-3 and plan.grid["draws"] == [10.0, 20.0]


def test_the_hash_knows_every_part() -> None:
    variants = [
        DRILL,
        {**DRILL, "runs": 8},
        {**DRILL, "seed": 1},
        {**DRILL, "chunk": 4},
        {**DRILL, "sigma": 2},
        {**DRILL, "grid": {"sigma": [2]}},
        {**DRILL, "draw": {"sigma": {"uniform": [1, 2]}}},
        {**DRILL, "limits": {"time_s": 5}},
    ]
    digests = [plan_of(v).digest for v in variants]
    assert len(set(digests)) == len(variants)
    assert plan_of(dict(reversed(DRILL.items()))).digest == digests[0]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31 - 1), st.floats(0.01, 10), st.floats(1.0, 100))
def test_draws_stay_in_range_and_do_not_mind_each_other(seed: int, low: float, factor: float) -> None:
    high = low * factor
    draws: dict[str, Any] = {
        "a": {"uniform": [low, high]},
        "b": {"log-uniform": [low, high]},
        "c": {"integer": [2, 4]},
        "d": {"choice": ["x", "y"]},
        "e": {"normal": [low, 0.0]},
    }
    found = drawn(draws, seed)
    assert low <= found["a"] <= high and low * (1 - 1e-12) <= found["b"] <= high * (1 + 1e-12)
    assert found["c"] in (2, 3, 4) and found["d"] in ("x", "y") and found["e"] == low
    for name in draws:
        assert drawn({name: draws[name]}, seed) == {name: found[name]}


def test_draws_have_their_distributions() -> None:
    spec: dict[str, Any] = {"u": {"uniform": [2, 4]}, "l": {"log-uniform": [1, 100]}, "n": {"normal": [1, 2]}}
    found = [drawn(spec, seed) for seed in range(2000)]
    u, l, n = (np.array([f[k] for f in found]) for k in "uln")
    assert abs(u.mean() - 3) < 0.06 and abs(u.std() - 2 / np.sqrt(12)) < 0.03
    assert abs(np.log10(l).mean() - 1) < 0.06
    assert abs(n.mean() - 1) < 0.2 and abs(n.std() - 2) < 0.15
