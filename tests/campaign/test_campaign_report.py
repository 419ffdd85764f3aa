"""Tables, box plots and the one-file page of a campaign."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massprops.campaigns.boxes import box_plot
from massprops.campaigns.configuration import plan_of
from massprops.campaigns.run import rows_csv, run_campaign
from massprops.campaigns.store import Row
from massprops.campaigns.table import Point, columns_of, document, summary
from massprops.campaigns.text import text_of


def test_percentiles_are_those_of_the_runs_that_did_not_fail() -> None:
    rng = np.random.default_rng(3)
    values = rng.standard_normal(101)
    rows = [Row(0, k, {"v": float(v), "cpu_ms": 1.0, "name": "x"}) for k, v in enumerate(values)]
    rows += [Row(0, 101, {"v": 1e9}, "broken"), Row(0, 102, {}, "broken"), Row(0, 103, {"v": float("nan")})]
    point = Point(0, {"sigma": 1}, {"sigma": 1}, rows)
    assert columns_of([point]) == ["v"]
    found = summary(point.values("v"))
    ordered = np.sort(values)
    assert found["n"] == 101 and found["p50"] == ordered[50] and found["p100"] == ordered[100]
    assert found["p5"] == ordered[5] and found["mean"] == pytest.approx(values.mean())
    assert found == summary(rng.permutation(values)), "the same to the last digit in any order"
    assert summary(np.zeros(0))["p50"] is None
    lines = rows_csv([point]).splitlines()
    assert lines[0] == "point,sigma,seed,v,cpu_ms,name,error" and len(lines) == 105
    assert float(lines[1].split(",")[3]) == values[0], "every digit"


def test_a_box_plot_stands_where_its_percentiles_are() -> None:
    values = np.linspace(0.0, 100.0, 1001)
    svg = box_plot([("one", values), ("two", values + 50)], "error")
    boxes = [tuple(map(float, m)) for m in re.findall(r'<rect [^>]*y="([\d.]+)" [^>]*height="([\d.]+)"', svg)]
    grid = [float(y) for y in re.findall(r'class="grid"[^>]*y1="([\d.]+)"', svg)]
    marks = [float(t) for t in re.findall(r'text-anchor="end">([\d.]+)<', svg)]
    scale = (grid[1] - grid[0]) / (marks[1] - marks[0])

    def at(y: float) -> float:
        return marks[0] + (y - grid[0]) / scale

    (top, high), (top2, high2) = boxes
    assert at(top) == pytest.approx(75, abs=0.5) and at(top + high) == pytest.approx(25, abs=0.5)
    assert at(top2) == pytest.approx(125, abs=0.5) and at(top2 + high2) == pytest.approx(75, abs=0.5)
    assert ">one<" in svg and ">two<" in svg


@pytest.mark.parametrize(
    "values", [np.zeros(3), np.ones(1), np.array([1e-9, 1.0, 1e6]), np.array([-3.0, 2.0]), np.array([5.0, 5.0, 150.1])]
)
def test_box_plots_of_odd_numbers(values: np.ndarray) -> None:
    svg = box_plot([("<script>", values), ("empty", np.zeros(0))], "a & b")
    assert svg.startswith("<svg") and "nan" not in svg and "inf" not in svg
    assert "<script>" not in svg and "a & b" not in svg
    assert box_plot([("empty", np.zeros(0))], "x") == ""


def test_the_page_is_one_file_that_asks_for_nothing(tmp_path: Path) -> None:
    content: dict[str, Any] = {
        "kind": "drill",
        "name": "<b>odd</b>",
        "runs": 40,
        "fails": 0.2,
        "grid": {"sigma": [1, 2]},
    }
    outcome = run_campaign(plan_of(content), tmp_path, workers=1)
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"(src|href)=\"(?!#|data:)", page) and "default-src 'none'" in page
    assert page.count('<svg class="plot"') == 2 and "&lt;b&gt;odd" in page and "<b>odd</b>" not in page
    assert "was asked to fail" in page and "80 of 80" in page and outcome.document["hash"] not in ("", None)
    text = text_of(outcome.document)
    assert "sigma 1" in text and "failed:" in text and f"{outcome.document['failed']} of 80" in text
    assert json.loads((tmp_path / "table.json").read_text()) == outcome.document


def test_nothing_but_failures_still_has_a_table(tmp_path: Path) -> None:
    outcome = run_campaign(plan_of({"kind": "drill", "runs": 3, "fails": 1.0}), tmp_path, workers=1)
    assert outcome.document["failed"] == 3 and "3 × ValueError" in text_of(outcome.document)
    assert "was asked to fail" in (tmp_path / "report.html").read_text()


def test_an_unfinished_document_says_so() -> None:
    plan = plan_of({"kind": "drill", "runs": 3})
    found = document(plan, [Point(0, {}, {}, [Row(0, 0, {"mean": 1.0})])])
    assert found["done"] == 1 and found["runs"] == 3
