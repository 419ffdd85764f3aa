"""What a run of a campaign can be: one file per kind, found by its name.

A file has
`SENTENCE`: one line for users; `OWN_THREADS`: whether a run uses several processor threads by itself;
`prepared(fixed, grid, folder, where) -> (fixed, grid)`: defaults filled in, paths made absolute;
`parameters(fixed, grid) -> list`: names that may be set; `check(parameters, where)`: refuses wrong values;
`default_runs(parameters)`: seeds per point; `chunk(fixed)`: runs per chunk;
`basis(plan)`: plain data the result depends on besides the configuration, for the hash;
`runs(parameters, seeds, folder) -> rows`: one flat row per seed in order, `error` in a row that failed; `folder` is
where a run may leave files, or None;
`tables(plan, points)`: tables of its own, [] for none; `boxes(plan)`: columns to draw, None for all;
`TITLES`, if it likes: columns in words, for the report.
What is the same whatever is asked is written with `always`; there are `as_given` and `checked_by`, too.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from massprops.errors import InputError
from massprops.packaged import names_of

Values = dict[str, Any]
Rows = list[dict[str, Any]]


class Kind(Protocol):
    """What such a file holds, as the top of this file says; `TITLES` may be left out."""

    SENTENCE: str
    OWN_THREADS: bool
    prepared: Callable[[Values, Values, Path, str], tuple[Values, Values]]
    parameters: Callable[[Values, Values], list[str]]
    check: Callable[[Values, str], None]
    default_runs: Callable[[Values], int]
    chunk: Callable[[Values], int]
    basis: Callable[[Any], Any]
    runs: Callable[[Values, list[int], Path | None], Rows]
    tables: Callable[[Any, list[Any]], Rows]
    boxes: Callable[[Any], list[str] | None]


def kinds() -> list[str]:
    """Names of the kinds."""
    return names_of(__name__)


def load_kind(name: str) -> Kind:
    """The file of one kind, which must be one of `kinds()`."""
    return cast(Kind, import_module(f"{__name__}.{name}"))


def always(value: Any) -> Callable[..., Any]:
    """A function of anything that gives `value`."""
    return lambda *_: value


def as_given(
    fixed: dict[str, Any], grid: dict[str, Any], folder: Path, where: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """`prepared` of a kind that fills in nothing."""
    return fixed, grid


def checked_by(made: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any], str], None]:
    """`check` of a kind that refuses what cannot be made of the values."""

    def check(values: dict[str, Any], where: str) -> None:
        try:
            made(values)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    return check
