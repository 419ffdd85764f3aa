"""A campaign that was run is extended by a configuration with more runs; wide tables are folded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from massprops.campaigns.configuration import plan_of
from massprops.campaigns.run import run_campaign
from massprops.campaigns.text import WIDTH, own_table
from massprops.errors import InputError

SIX: dict[str, Any] = {"kind": "drill", "runs": 6, "chunk": 4, "grid": {"sigma": [1, 2]}}


def test_six_runs_become_eight_and_are_what_eight_at_once_are(tmp_path: Path) -> None:
    run_campaign(plan_of(SIX), tmp_path / "grown", workers=1)
    told: list[int] = []
    eight = plan_of({**SIX, "runs": 8})
    grown = run_campaign(eight, tmp_path / "grown", workers=1, watch=lambda now: told.append(now.done))
    whole = run_campaign(eight, tmp_path / "whole", workers=1)
    assert told[0] >= 12 and told[-1] == 16, "the first twelve runs are not made again"
    assert grown.document == whole.document
    for name in ("table.json", "runs.csv"):
        assert (tmp_path / "grown" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    ten = plan_of({**SIX, "runs": 10})
    assert run_campaign(ten, tmp_path / "grown", workers=1).document["done"] == 20


def test_only_more_runs_extend(tmp_path: Path) -> None:
    run_campaign(plan_of({**SIX, "runs": 8}), tmp_path, workers=1)
    for other in ({"runs": 6}, {"runs": 9, "grid": {"sigma": [1, 3]}}, {"runs": 9, "seed": 1}):
        with pytest.raises(InputError, match="another configuration"):
            run_campaign(plan_of({**SIX, **other}), tmp_path, workers=1)


def test_a_wide_table_is_folded_and_keeps_every_cell() -> None:
    columns = ["case", *(f"quantity number {i}" for i in range(20))]
    rows = [[f"row {r}", *(f"{r}.{i}" for i in range(20))] for r in range(3)]
    text = own_table({"title": "wide", "columns": columns, "rows": rows})
    assert max(map(len, text.splitlines())) <= WIDTH
    words = text.split()
    assert all(cell in words for row in rows for cell in row[1:])
    assert text.count("row 1") > 1
