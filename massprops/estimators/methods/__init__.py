"""One file per estimator, found by its name.

Each file has `NAME`, `SENTENCE` (one line for users), `NEEDS` (what the sequence must hold) and
`estimate(problem, prior, start) -> Estimate`. Adding a file adds the estimator.

`NEEDS` is a tuple of the words tracks, stereo, range, rates, attitude, all of which must be there; alternatives in one
entry are parted by `|`: ("stereo", "range"), ("attitude|rates",). A file may also have `unmet(problem) -> str`, one
line of what else is missing, or an empty string. An `estimate` that takes `model` is given the one the user named.
`BEGINS_EARLY`: it begins with the first part of the data, of which `start.early` is the first guess.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType


@cache
def methods() -> dict[str, ModuleType]:
    """The estimators by name, in the order of their `ORDER`, then name."""
    files = (p.stem for p in Path(__file__).parent.glob("*.py") if not p.stem.startswith("_"))
    found = [import_module(f"{__name__}.{stem}") for stem in sorted(files)]
    named = [m for m in found if hasattr(m, "NAME")]
    return {m.NAME: m for m in sorted(named, key=lambda m: (getattr(m, "ORDER", 50), m.NAME))}
