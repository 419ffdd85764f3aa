"""One file per estimator, found by its name.

Each file has `NAME`, `SENTENCE` (one line for users), `NEEDS` (what the sequence must hold) and
`estimate(problem, prior, start) -> Estimate`. Adding a file adds the estimator; so does an installed package, by an entry
point of the group `massprops.estimators` whose value is such a module.

`NEEDS` is a tuple of the words tracks, stereo, range, rates, attitude, all of which must be there; alternatives in one
entry are parted by `|`: ("stereo", "range"), ("attitude|rates",). A file may also have `unmet(problem) -> str`, one
line of what else is missing, or an empty string. An `estimate` that takes `model` is given the one the user named.
`BEGINS_EARLY`: it begins with the first part of the data, of which `start.early` is the first guess.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Protocol, cast

from massprops.effect_contract import is_hyphenated
from massprops.estimators.needs import SAID
from massprops.estimators.result import Estimate
from massprops.packaged import modules_of, packaged


class Method(Protocol):
    """What such a file holds; the rest may be left out."""

    NAME: str
    SENTENCE: str
    NEEDS: tuple[str, ...]
    estimate: Callable[..., Estimate]


@cache
def methods() -> dict[str, Method]:
    """The estimators by name, in the order of their `ORDER`, then name."""
    by_name = cast("dict[str, Method]", {**own(), **_packaged()[0]})
    return dict(sorted(by_name.items(), key=lambda pair: (getattr(pair[1], "ORDER", 50), pair[0])))


@cache
def own() -> dict[str, ModuleType]:
    """The estimators that are files of massprops, by name."""
    return {module.NAME: module for module in modules_of(__name__)}


def refused() -> dict[str, str]:
    """Entry points of installed packages that are left out, with what is wrong with them."""
    return _packaged()[1]


@cache
def _packaged() -> tuple[dict[str, ModuleType], dict[str, str]]:
    return packaged("massprops.estimators", faults, own())


def faults(method: ModuleType) -> str:
    """What is wrong with an estimator in one line that says what to do; empty when nothing is."""
    name = getattr(method, "NAME", None)
    if not is_hyphenated(name):
        return "NAME must be small letters and digits joined by hyphens, such as 'range-ukf'"
    if not isinstance(getattr(method, "SENTENCE", None), str):
        return "SENTENCE must be a text"
    needs = getattr(method, "NEEDS", None)
    if not isinstance(needs, tuple) or any(word not in SAID for entry in needs for word in str(entry).split("|")):
        return f"NEEDS must be a tuple of any of: {', '.join(SAID)}; alternatives parted by |; () for nothing"
    function = getattr(method, "estimate", None)
    if not callable(function) or list(inspect.signature(function).parameters)[:3] != ["problem", "prior", "start"]:
        return "it must have a function estimate(problem, prior, start)"
    return ""
