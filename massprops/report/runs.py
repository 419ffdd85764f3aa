"""A page of several runs: each with a picture, its verdict and its numbers; of two, what differs."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

from massprops.core.files import hash_of
from massprops.core.outputs import deliver
from massprops.core.processes import silenced_stderr
from massprops.errors import InputError
from massprops.mass.document import read_document
from massprops.mass.recommended import as_recommended, quantities
from massprops.report.data import read_json
from massprops.report.html import Safe, data_uri, number, table, text
from massprops.report.page import of_sections
from massprops.report.thumbnail import thumbnail

OWNER, NAME = "view", "runs.html"
QUANTITIES = ("volume", "mass", "I1", "I2", "I3", "k1", "k2")
MOST = 500


def runs_in(folder: Path) -> list[Path]:
    """Folders right below this one that hold a run, by name."""
    run_folders = [
        p
        for p in sorted(folder.iterdir())
        if p.is_dir() and ((p / "massprops.json").is_file() or (p / "report.json").is_file())
    ]
    return run_folders[:MOST]


def write_runs(folder: Path, runs: list[Path], force: bool = False) -> Path:
    """Writes `runs.html` into a folder: a list of runs, or a comparison of two.

    Args:
        folder: where the page goes; links to the runs are relative to it.
        runs: run folders.
        force: a `runs.html` that massprops did not write may be replaced.

    Raises:
        InputError: no runs, or the folder cannot be written.
    """
    if not runs:
        raise InputError(f"{folder}: no runs in this folder; give a folder in which 'massprops reconstruct' made runs")
    entries = [_Run(path, folder) for path in runs]
    apart = _compared(*entries) if len(entries) == 2 else ""
    parts = (("runs", "Runs", _listed(entries)), ("compared", "Differences", apart))
    whole = of_sections(f"massprops · {len(entries)} runs", parts, str(folder.resolve()))
    deliver(folder, OWNER, {NAME: whole}, hash_of([r.document for r in entries]), force=force)
    return folder / NAME


def _document(path: Path) -> dict[str, Any]:
    """`massprops.json`, or {} where it is missing or its numbers are none of a body."""
    try:
        return read_document(path)
    except InputError:
        return {}


class _Run:
    """What the page says of one run; files that are missing or broken leave gaps."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path = path
        self.document = _document(path / "massprops.json")
        self.crosscheck, self.verdict = read_json(path / "crosscheck.json"), read_json(path / "report.json")
        self.values = quantities(as_recommended(self.document)) if self.document else {}
        self.metric = (self.document.get("units") or {}).get("length") == "m"
        try:
            self.link = quote(path.resolve().relative_to(folder.resolve()).as_posix()) + "/report.html"
        except ValueError:
            self.link = (path.resolve() / "report.html").as_uri()

    def value(self, quantity: str) -> float | None:
        return self.values[quantity][0] if self.values else None

    def bounds(self, quantity: str) -> Any:
        return self.values[quantity][1] if self.values else None

    def with_interval(self, quantity: str) -> str:
        value, bounds = self.value(quantity), self.bounds(quantity)
        if value is None:
            return "–"
        half = "" if not bounds or None in bounds else f" ± {number(0.5 * (bounds[1] - bounds[0]), 2)}"
        return number(value, 4) + half

    @property
    def unit(self) -> str:
        return "m³" if self.metric else "unit³"

    def unit_of(self, quantity: str) -> str:
        if quantity == "volume":
            return self.unit
        if not self.metric:
            return ""
        return {"mass": "kg"}.get(quantity, "kg m²" if quantity.startswith("I") else "")

    @property
    def judged(self) -> Safe:
        trust = self.document.get("confidence") or {}
        level = str(trust.get("level") or "")
        colour = {"high": "good", "low": "bad"}.get(level, "")
        parts = [f'<b class="{colour}">{text(level)}</b>'] if level else []
        if self.crosscheck.get("verdict"):
            parts.append(f"shape against motion: {text(self.crosscheck['verdict'])}")
        if self.verdict.get("exit_code"):
            parts.append(f'<span class="bad">{text(self.verdict.get("reason", "stopped"))}</span>')
        return Safe("; ".join(parts) or ("a finished mesh, not judged" if self.document else "–"))

    @property
    def picture(self) -> Safe:
        import cv2

        frames = sorted((self.path / "work" / "capture" / "frames").rglob("*.*"))
        with silenced_stderr():
            image = cv2.imread(str(frames[len(frames) // 2])) if frames else None
        if image is None:
            return Safe("")
        small = data_uri(thumbnail(image, None, 120))
        return Safe(f'<img alt="a frame of {text(self.path.name)}" width="120" class="thumb" src="{small}">')

    @property
    def name(self) -> Safe:
        there = (self.path / "report.html").is_file()
        return Safe(f'<a href="{text(self.link)}">{text(self.path.name)}</a>' if there else text(self.path.name))


def _listed(runs: list[_Run]) -> str:
    """A row for each run; a phone shows the first two columns, which say most."""
    rows = [
        (
            Safe(f"{r.name.content}{r.picture.content}"),
            Safe(f'{text(r.with_interval("volume"))} {r.unit}<span class="below">{r.judged.content}</span>'),
            r.with_interval("k1"),
            r.with_interval("k2"),
        )
        for r in runs
    ]
    return table(rows, ("run", "volume ± 90 %, confidence", "k1", "k2"), numeric=(2, 3), label="runs")


def _apart(ratio: float) -> str:
    """In per cent; as a factor where that says more."""
    return f"{100 * (ratio - 1):+.2f} %" if 0.1 < ratio < 10 else f"× {number(ratio, 3)}"


def _compared(a: _Run, b: _Run) -> str:
    """Quantity by quantity, and whether the two agree within their intervals."""
    rows = []
    for quantity in QUANTITIES:
        one, two = a.value(quantity), b.value(quantity)
        apart, meet = "–", "–"
        if one is not None and two is not None:
            apart = f"{two - one:+.4f}" if quantity.startswith("k") or not one else _apart(two / one)
            first, second = a.bounds(quantity), b.bounds(quantity)
            # a value without an interval, as of a CAD mesh, is held against the other's
            (low, high), (other_low, other_high) = first or (one, one), second or (two, two)
            if (first or second) and None not in (low, high, other_low, other_high):
                meet = "yes" if low <= other_high and other_low <= high else "no"
        unit = a.unit_of(quantity) if a.metric == b.metric else ""
        rows.append(
            (
                f"{quantity} [{unit}]" if unit else quantity,
                apart.replace("-", "−"),
                a.with_interval(quantity),
                b.with_interval(quantity),
                meet,
            )
        )
    note = (
        "" if a.metric == b.metric else "<p>One of the two has no length scale, so only k1 and k2 can be compared.</p>"
    )
    return note + table(
        rows, ("", "second minus first", a.path.name, b.path.name, "agree within 90 %"), label="two runs"
    )
