"""What a module must hold to be an estimator (`massprops.estimators.methods` says it in words)."""

from __future__ import annotations

import inspect
import re
from types import ModuleType

from massprops.estimators.needs import SAID


def faults(method: ModuleType) -> str:
    """What is wrong with an estimator in one line that says what to do; empty when nothing is."""
    name = getattr(method, "NAME", None)
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
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
