"""`massprops view RUNS/`: a list of runs, and what differs between two."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fake_run import HOSTILE, make_run

from massprops.errors import InputError
from massprops.report import write_report
from massprops.report.runs import runs_in, write_runs


def test_runs_are_listed_with_picture_verdict_and_volume(tmp_path: Path) -> None:
    one = make_run(tmp_path / "one")
    write_report(one)
    document = json.loads((one / "massprops.json").read_text())
    document["confidence"] = {"level": "low", "because": [HOSTILE]}
    (one / "massprops.json").write_text(json.dumps(document))
    two = make_run(tmp_path / "two", metric=False)
    (two / "report.json").write_text(json.dumps({"exit_code": 3, "reason": HOSTILE}))
    (tmp_path / "other").mkdir()
    assert [p.name for p in runs_in(tmp_path)] == ["one", "two"]
    page = write_runs(tmp_path, runs_in(tmp_path)).read_text()
    assert page.count("<img alt=") == 2 and 'href="one/report.html"' in page and 'href="two/' not in page
    assert "low" in page and "window.hit=1</script>" not in page and "unit³" in page
    assert "One of the two has no length scale" in page
    with pytest.raises(InputError, match="no runs"):
        write_runs(tmp_path / "other", [])


def test_two_runs_are_compared(tmp_path: Path) -> None:
    runs = [make_run(tmp_path / name) for name in ("a", "b")]
    document = json.loads((runs[1] / "massprops.json").read_text())
    document["recommended"]["volume"] *= 1.5
    document["recommended"]["interval_90"]["volume"] = [1.4 * document["volume"], 1.6 * document["volume"]]
    (runs[1] / "massprops.json").write_text(json.dumps(document))
    page = write_runs(tmp_path, runs).read_text()
    del document["recommended"]["interval_90"]["volume"]
    (runs[1] / "massprops.json").write_text(json.dumps(document))
    agree = write_runs(tmp_path, runs).read_text().split("<td>volume [m³]</td>")[1].split("</tr>")[0]
    assert agree.endswith("<td class=n>no</td>"), "a value without an interval is held against the other's"
    assert "+50.00 %" in page and "+0.00 %" in page and ">no<" in page and ">yes<" in page
