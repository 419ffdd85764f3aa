"""Reads a campaign's configuration and divides it into grid points, seeds and chunks."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from massprops.campaigns.draws import check_draw, extremes
from massprops.campaigns.kinds import Kind, kinds, load_kind
from massprops.core.files import hash_of, plain
from massprops.documents.campaign import LARGEST_SEED, CampaignFile
from massprops.documents.fields import keys, read, unknown
from massprops.documents.loading import excerpt
from massprops.errors import InputError

MOST_RUNS = 1_000_000
RESERVED = tuple(keys(CampaignFile))
MAYBE_EMPTY = ("seed",)
"""Keys whose `null` is the default, not a value."""
EXPONENT = re.compile(r"[+-]?\d+(\.\d*)?[eE][+-]?\d+")


@dataclass(frozen=True)
class Chunk:
    """Some seeds of one grid point, which one worker does together. The configuration decides the chunks, not the workers."""

    point: int
    parameters: dict[str, Any]
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """A campaign laid out.

    Attributes:
        name: for people.
        kind: name of the kind of run.
        fixed: parameters common to all runs; grid: values per axis; draw: distributions per drawn parameter.
        runs: seeds per point; None takes the kind's own number for the point.
        seed: the first seed; a point's seeds follow one another.
        chunk: runs per chunk.
        time_s, memory_mb: limits of one run, None for none.
        digest: sha256 of all of the above and of what the kind takes from elsewhere.
        where: file or command it came from, for messages.
    """

    name: str
    kind: str
    fixed: dict[str, Any]
    grid: dict[str, list[Any]]
    draw: dict[str, Any]
    runs: int | None
    seed: int
    chunk: int
    time_s: float | None
    memory_mb: float | None
    digest: str = ""
    where: str = "configuration"

    @property
    def points(self) -> int:
        """Number of combinations of the grid."""
        return math.prod(len(values) for values in self.grid.values())

    def cells(self) -> Iterator[dict[str, Any]]:
        """The grid's values, point by point; the last axis varies fastest."""
        for values in itertools.product(*self.grid.values()):
            yield dict(zip(self.grid, values, strict=True))

    def laid_out(self) -> Iterator[tuple[int, dict[str, Any], dict[str, Any]]]:
        """Every point: its number, what the grid sets of it, and that with what is common to all."""
        for number, cell in enumerate(self.cells()):
            yield number, cell, {**self.fixed, **cell}

    def seeds(self, parameters: dict[str, Any]) -> range:
        """The seeds of a point."""
        count = self.runs if self.runs is not None else load_kind(self.kind).default_runs(parameters)
        return range(self.seed, self.seed + count)

    @property
    def total(self) -> int:
        """Number of runs."""
        if self.runs is not None:
            return self.points * self.runs
        return sum(len(self.seeds(parameters)) for _, _, parameters in self.laid_out())

    def chunks(self) -> Iterator[Chunk]:
        """Every chunk in order."""
        for point, _, parameters in self.laid_out():
            seeds = self.seeds(parameters)
            for first in range(0, len(seeds), self.chunk):
                yield Chunk(point, parameters, tuple(seeds[first : first + self.chunk]))

    def document(self) -> dict[str, Any]:
        """The configuration with every default filled in."""
        limits = {"time_s": self.time_s, "memory_mb": self.memory_mb}
        document: dict[str, Any] = plain(
            {
                "kind": self.kind,
                "name": self.name,
                **self.fixed,
                "grid": self.grid,
                "draw": self.draw,
                "runs": self.runs,
                "seed": self.seed,
                "chunk": self.chunk,
                "limits": {k: v for k, v in limits.items() if v is not None},
            }
        )
        return document


def read_configuration(path: str | Path) -> Plan:
    """The plan of a YAML file; files it names are relative to it.

    Raises:
        InputError: no such file, not YAML, or see `plan_of`.
    """
    from massprops.documents.loading import load_yaml

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file: give the campaign's YAML file")
    return plan_of(load_yaml(path), str(path), path.resolve().parent)


def plan_of(content: dict[str, Any], where: str = "configuration", folder: Path | None = None) -> Plan:
    """Checks a configuration and fills in its defaults.

    Args:
        content: keys of `RESERVED`, and parameters of the kind.
        where: named in messages.
        folder: what relative paths in it start from.

    Raises:
        InputError: an unknown key (with the nearest known one), a value out of range, or nothing to run.
    """
    content = _numbers(content)
    document = _document(content, where)
    if "kind" not in content:
        raise InputError(f"{where}: no kind: give one of {', '.join(kinds())}")
    if content["kind"] not in kinds():
        raise unknown("kind", content["kind"], kinds(), where)
    kind = load_kind(content["kind"])
    grid, draw = dict(document.grid or {}), dict(document.draw or {})
    fixed = {key: value for key, value in content.items() if key not in RESERVED}
    fixed, grid = kind.prepared(fixed, grid, folder or Path.cwd(), where)
    _known_keys(where, kind, fixed, grid, draw)
    for axis, values in grid.items():
        if not isinstance(values, list) or not values:
            raise InputError(f"{where}: grid of {excerpt(axis)}: give a list of values, not {excerpt(values)}")
    for name, spec in draw.items():
        check_draw(where, name, spec)
    plan = Plan(
        name=document.name or content["kind"],
        kind=content["kind"],
        fixed=fixed,
        grid=grid,
        draw=draw,
        runs=document.runs,
        seed=document.seed,
        chunk=kind.chunk(fixed) if document.chunk is None else document.chunk,
        time_s=None if document.limits is None else document.limits.time_s,
        memory_mb=None if document.limits is None else document.limits.memory_mb,
        where=where,
    )
    _check_values(plan, kind)
    return replace(plan, digest=_digest(plan))


def _digest(plan: Plan) -> str:
    return hash_of({"configuration": plan.document(), "basis": load_kind(plan.kind).basis(plan)})


def extends(plan: Plan, runs: Any, digest: str) -> bool:
    """Whether a plan is the one of that digest with more runs at every point: those of the other are its first ones.

    Args:
        plan: the larger one.
        runs: seeds per point of the other.
        digest: of the other.
    """
    if not isinstance(runs, int) or plan.runs is None or not runs < plan.runs:
        return False
    return _digest(replace(plan, runs=runs)) == digest


def check_size(plan: Plan, yes: bool) -> None:
    """Asks for consent before a very large campaign.

    Raises:
        InputError: more than a million runs, and no consent; or seeds beyond the largest.
    """
    longest = plan.runs if plan.runs is not None else max(len(plan.seeds(p)) for _, _, p in plan.laid_out())
    if plan.total > MOST_RUNS and not yes:
        raise InputError(
            f"{plan.where}: this makes {plan.total} runs ({plan.points} points of the grid): give --yes to start them, or "
            "shorten the grid or lower 'runs'"
        )
    if plan.seed + longest - 1 > LARGEST_SEED:
        raise InputError(
            f"{plan.where}: seeds go up to {plan.seed + longest - 1}, and the largest is {LARGEST_SEED}: lower 'seed' or 'runs'"
        )


def _known_keys(where: str, kind: Kind, fixed: dict[str, Any], grid: dict[str, Any], draw: dict[str, Any]) -> None:
    known = kind.parameters(fixed, grid)
    for part, content, names in (("key", fixed, [*RESERVED, *known]), ("grid", grid, known), ("draw", draw, known)):
        for key in content:
            if key not in names:
                what = "key" if part == "key" else f"parameter under {part}"
                raise unknown(what, key, names, where)
    for first, second in ((fixed, grid), (fixed, draw), (grid, draw)):
        twice = sorted(set(first) & set(second))
        if twice:
            raise InputError(f"{where}: {twice[0]} is set twice: keep it in one of key, grid and draw")


def _check_values(plan: Plan, kind: Kind) -> None:
    """Checks every value of every axis once, at one common point, not all combinations."""
    axes = {**plan.grid, **{name: extremes(spec) for name, spec in plan.draw.items()}}
    first = {name: values[0] for name, values in axes.items()}
    kind.check({**plan.fixed, **first}, plan.where)
    for axis, values in axes.items():
        for value in values[1:]:
            kind.check({**plan.fixed, **first, axis: value}, plan.where)


def _document(content: dict[str, Any], where: str) -> CampaignFile:
    """The keys of every campaign; those of its kind stand beside them and are checked by the kind."""
    reserved = {k: v for k, v in content.items() if k in RESERVED and not (k in MAYBE_EMPTY and v is None)}
    if reserved.get("name") is not None:
        reserved["name"] = str(reserved["name"])
    return read(CampaignFile, {"kind": "", **reserved}, where)


def _numbers(value: Any) -> Any:
    """Converts texts such as 1e-3, which YAML does not read as numbers."""
    if isinstance(value, dict):
        return {str(k): _numbers(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_numbers(v) for v in value]
    return float(value) if isinstance(value, str) and EXPONENT.fullmatch(value) else value
