"""Runs of a published case: `paper`, `case`, and any number of its set-up by name, nested ones with dots."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from massprops.campaigns.kinds import checked_by
from massprops.campaigns.papers import checked_case, load_paper, papers
from massprops.documents.fields import unknown
from massprops.documents.loading import excerpt
from massprops.errors import InputError

SENTENCE = "A case of one of the five papers, or changes of it."
OWN_THREADS = False
CHUNK = 2
"""Of a paper that names no number: runs of seconds, of which a kill should not cost many."""


def prepared(
    fixed: dict[str, Any], grid: dict[str, Any], folder: Path, where: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """All cases when none is named."""
    if "paper" not in fixed:
        raise InputError(f"{where}: no paper: give one of {', '.join(papers())}")
    paper = load_paper(str(fixed["paper"]))
    if "case" not in fixed and "case" not in grid:
        grid = {"case": list(paper.CASES), **grid}
    cases = grid.get("case", [fixed.get("case")])
    for case in cases if isinstance(cases, list) else [cases]:
        checked_case(paper, str(case))
    if isinstance(cases, list):
        key = grid if "case" in grid else fixed
        key["case"] = [str(c) for c in cases] if key is grid else str(cases[0])
    return fixed, grid


def _cases(fixed: dict[str, Any], grid: dict[str, Any]) -> list[str]:
    return list(grid["case"]) if "case" in grid else [fixed["case"]]


def parameters(fixed: dict[str, Any], grid: dict[str, Any]) -> list[str]:
    """`paper`, `case`, and what the set-ups of its cases hold."""
    paper = load_paper(fixed["paper"])
    names: dict[str, None] = {"paper": None, "case": None}
    for case in _cases(fixed, grid):
        names.update(dict.fromkeys(_flat(paper.configuration(case))))
    return list(names)


def _flat(content: dict[str, Any], before: str = "") -> list[str]:
    names = []
    for key, value in content.items():
        names.append(before + key)
        if isinstance(value, dict):
            names += _flat(value, f"{before}{key}.")
    return names


def set_up(values: dict[str, Any]) -> dict[str, Any]:
    """The case's whole set-up with the given changes.

    Raises:
        InputError: the case has no such value, or it is of another kind.
    """
    paper = load_paper(values["paper"])
    setup: dict[str, Any] = copy.deepcopy(paper.configuration(values["case"]))
    for name, value in values.items():
        if name in ("paper", "case"):
            continue
        *path, last = name.split(".")
        part = setup
        for key in path:
            part = part.get(key) if isinstance(part, dict) else None
        if not isinstance(part, dict) or last not in part:
            raise unknown(f"parameter of {values['paper']} {values['case']}", name, _flat(setup))
        old = part[last]
        if _kind_name(old) != _kind_name(value) and old is not None:
            raise InputError(f"{name} {excerpt(value)}: give {_kind_name(old)} like {old!r}")
        part[last] = value
    return setup


def _kind_name(value: Any) -> str:
    for kind, name in ((bool, "yes or no"), ((int, float), "a number"), (str, "a text"), (list, "a list")):
        if isinstance(value, kind):
            return name
    return "names with values"


check = checked_by(set_up)


def default_runs(values: dict[str, Any]) -> int:
    """The number that the paper's table stands on, or the most that a computer here bears."""
    return int(load_paper(values["paper"]).RUNS[values["case"]])


def chunk(fixed: dict[str, Any]) -> int:
    """Runs per chunk."""
    return int(getattr(load_paper(fixed["paper"]), "CHUNK", CHUNK))


def basis(plan: Any) -> Any:
    """The set-up of every case."""
    paper = load_paper(plan.fixed["paper"])
    return {case: paper.configuration(case) for case in _cases(plan.fixed, plan.grid)}


def runs(values: dict[str, Any], seeds: list[int], folder: Path | None) -> list[dict[str, Any]]:
    """The paper's own runs."""
    return list(load_paper(values["paper"]).runs(set_up(values), list(seeds)))


def tables(plan: Any, points: list[Any]) -> list[dict[str, Any]]:
    """The paper's table of every point, ours beside theirs."""
    paper = load_paper(plan.fixed["paper"])
    paper_tables = []
    for point in points:
        case = point.parameters["case"]
        table = dict(paper.table(case, point.dictionaries()))
        changes = {k: v for k, v in point.cell.items() if k != "case"}
        if changes or plan.draw:
            changed = ", ".join([f"{k} {v}" for k, v in changes.items()] + [f"{k} drawn" for k in plan.draw])
            table["title"] = f"{table['title']} — with {changed}"
        paper_tables.append({"case": case, **table})
    return paper_tables


def boxes(plan: Any) -> list[str] | None:
    """What the paper's file asks for, else all."""
    wanted = getattr(load_paper(plan.fixed["paper"]), "BOXES", None)
    if isinstance(wanted, dict):
        cases = _cases(plan.fixed, plan.grid)
        return list(dict.fromkeys(c for case in cases for c in wanted.get(case, ())))
    return None if wanted is None else list(wanted)
