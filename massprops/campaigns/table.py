"""The result of many runs: counts, failures and percentiles of every column, point by point."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from massprops.campaigns.configuration import Plan
from massprops.campaigns.kinds import load_kind
from massprops.campaigns.store import Row, Store

PERCENTILES = (5, 25, 50, 75, 95, 100)
HEAD = ["", "runs", "failed", "mean", *(f"{p} %" if p < 100 else "max" for p in PERCENTILES)]
"""Of the rows of `percentile_rows`."""
MOST_POINTS = 60
"""Points that are shown of a grid; all are in `table.json`."""
MEASURED = ("cpu_", "wall_")
"""Beginnings of columns that hold measured times, which no two runs share."""


@dataclass(frozen=True)
class Point:
    """One point of the grid with its finished runs.

    Attributes:
        number: its place; cell: what the grid set; parameters: with the fixed ones.
        rows: in the order of their seeds.
    """

    number: int
    cell: dict[str, Any]
    parameters: dict[str, Any]
    rows: list[Row] = field(default_factory=list)

    @property
    def label(self) -> str:
        """What tells this point from the others."""
        return _label(self.cell)

    @property
    def failed(self) -> int:
        return sum(row.error is not None for row in self.rows)

    def dictionaries(self) -> list[dict[str, Any]]:
        """Rows as flat dictionaries with `seed`, and `error` where one failed."""
        return [{"seed": r.seed, **r.data, **({} if r.error is None else {"error": r.error})} for r in self.rows]

    def values(self, column: str) -> np.ndarray:
        """(n,) finite numbers of a column, of the runs that did not fail."""
        entries = [r.data.get(column) for r in self.rows if r.error is None]
        numbers = [float(v) for v in entries if isinstance(v, int | float) and not isinstance(v, bool)]
        array: np.ndarray = np.array(numbers, float)
        return array[np.isfinite(array)]


def _label(cell: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_short(value)}" for name, value in cell.items()) or "all"


def _short(value: Any) -> str:
    if isinstance(value, list):
        return "+".join(_short(v) for v in value) or "none"
    if isinstance(value, dict):
        return str(value.get("name") or ", ".join(f"{k} {_short(v)}" for k, v in value.items()))
    if isinstance(value, float):
        return f"{value:g}"
    return str(value)


def points_of(plan: Plan, store: Store) -> list[Point]:
    """Every point that has runs."""
    known = store.counts()
    return [
        Point(number, cell, parameters, store.rows(number))
        for number, cell, parameters in plan.laid_out()
        if known.get(number)
    ]


def columns_of(points: list[Point]) -> list[str]:
    """Columns with numbers, in the order in which they first come; measured times are left out."""
    columns: dict[str, None] = {}
    for point in points:
        for row in point.rows:
            for name, value in row.data.items():
                number = isinstance(value, int | float) and not isinstance(value, bool)
                if number and not name.startswith(MEASURED) and name != "seed":
                    columns[name] = None
    return list(columns)


def summary(values: np.ndarray) -> dict[str, float | int | None]:
    """Count, mean and percentiles of (n,) numbers; None where there are none."""
    if not len(values):
        return {"n": 0, "mean": None, **{f"p{p}": None for p in PERCENTILES}}
    # summed in order of size: the same to the last digit however the runs were spread
    ordered = np.sort(values)
    marks = np.percentile(ordered, PERCENTILES)
    return {
        "n": len(ordered),
        "mean": float(ordered.mean()),
        **{f"p{p}": float(m) for p, m in zip(PERCENTILES, marks, strict=True)},
    }


def document(plan: Plan, points: list[Point]) -> dict[str, Any]:
    """The result of a campaign as plain JSON: the same to the last digit on any number of workers."""
    columns = columns_of(points)
    return {
        "format": "massprops-campaign/1",
        "name": plan.name,
        "configuration": plan.document(),
        "hash": plan.digest,
        "runs": plan.total,
        "done": sum(len(p.rows) for p in points),
        "failed": sum(p.failed for p in points),
        "failures": dict(
            sorted(Counter(_kind_of(r.error) for p in points for r in p.rows if r.error is not None).items())
        ),
        "points": [
            {
                "point": p.number,
                "parameters": p.cell,
                "runs": len(p.rows),
                "failed": p.failed,
                "columns": {name: summary(p.values(name)) for name in columns},
            }
            for p in points
        ],
        "tables": load_kind(plan.kind).tables(plan, points),
    }


def _kind_of(error: str) -> str:
    """An error message without its numbers, which differ from run to run."""
    return error.split(":")[0] if ": " in error else error


def percentile_rows(document: dict[str, Any]) -> Iterator[tuple[str, list[list[Any]]]]:
    """Every column of a campaign with its rows, one for each of the first `MOST_POINTS` points (see `HEAD`)."""
    for name in dict.fromkeys(name for p in document["points"] for name in p["columns"]):
        rows = []
        for point in document["points"][:MOST_POINTS]:
            s = point["columns"][name]
            marks = [s[f"p{p}"] for p in PERCENTILES]
            rows.append([_label(point["parameters"]), s["n"], point["failed"], s["mean"], *marks])
        yield name, rows


def left_out(document: dict[str, Any]) -> str:
    """What to say below tables of the first `MOST_POINTS` points; empty where these are all."""
    count = len(document["points"])
    return f"The first {MOST_POINTS} of {count} points; all are in table.json." if count > MOST_POINTS else ""
