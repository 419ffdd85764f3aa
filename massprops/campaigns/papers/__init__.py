"""The papers, one file each, found by name; and `smoother`, which is compared with the Cramér-Rao bound.

A file has `PAPER`, `CASES` (case -> one sentence), `RUNS` (case -> default number of runs), `configuration(case)` (the
whole set-up as plain JSON), `runs(configuration, seeds) -> rows` (one flat row per seed, in order; a failed run is a row
with `error`; the row of a seed does not depend on the other seeds) and `table(case, rows)` (`title`, `columns`, `rows`,
`notes`: ours beside the paper's). Optional: `CHUNK` (runs worked on together), `BOXES` (case -> columns to draw),
`speed()` (a benchmark as a flat dict), `REFERENCE` (where it was published). Files whose names begin with an underscore are parts of one. Adding a file adds the
paper; so does an installed package, by an entry point of the group `massprops.papers` whose value is such a module.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any, Protocol, cast

from massprops.campaigns.papers._references import Reference
from massprops.documents.fields import unknown
from massprops.packaged import Wanted, faults_by, is_text, names_of, packaged, takes

SPEED = "speed"
"""Name of the benchmark that a paper's file may have, asked for like a case."""


WANTED: Wanted = {
    "PAPER": is_text,
    "CASES": bool,
    "RUNS": bool,
    "configuration": takes(1),
    "runs": takes(2),
    "table": takes(2),
}


class Paper(Protocol):
    """What such a file holds; the rest may be left out."""

    PAPER: str
    CASES: dict[str, str]
    RUNS: dict[str, int]

    def configuration(self, case: str) -> dict[str, Any]:
        """See the top of this file."""
        ...

    def runs(self, configuration: dict[str, Any], seeds: list[int], /) -> list[dict[str, Any]]:
        """See the top of this file."""
        ...

    def table(self, case: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
        """See the top of this file."""
        ...


def papers() -> list[str]:
    """Names of all papers."""
    return sorted([*names_of(__name__), *_packaged()])


@cache
def _packaged() -> dict[str, Paper]:
    return cast("dict[str, Paper]", packaged("massprops.papers", faults_by(WANTED), names_of(__name__), "PAPER")[0])


def load_paper(name: str) -> Paper:
    """The file of one paper.

    Raises:
        InputError: there is none of that name.
    """
    if name in names_of(__name__):
        return cast(Paper, import_module(f"{__name__}.{name}"))
    if name in _packaged():
        return _packaged()[name]
    raise unknown("paper", name, papers())


def references() -> dict[str, Reference]:
    """Where each paper was published, by its name; only of those that say it (`REFERENCE`)."""
    every = {name: load_paper(name) for name in papers()}
    return {name: paper.REFERENCE for name, paper in every.items() if hasattr(paper, "REFERENCE")}


def checked_case(paper: Paper, case: str) -> str:
    """The case, when the paper has it.

    Raises:
        InputError: it has not.
    """
    if case not in paper.CASES:
        raise unknown(f"case of {paper.PAPER}", case, list(paper.CASES))
    return case
