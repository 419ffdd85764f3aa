"""Modules of a registry: those of a package of massprops, and those that installed packages bring by entry points."""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

from massprops.effect_contract import first_line

Wanted = Mapping[str, Callable[[Any], bool]]
"""What a module must hold: name, and whether a value will do."""


def is_text(value: Any) -> bool:
    """Whether a value is a text with something in it and no space about it."""
    return isinstance(value, str) and value.strip() == value != ""


def is_flag(value: Any) -> bool:
    """Whether a value is yes or no."""
    return isinstance(value, bool)


def takes(count: int) -> Callable[[Any], bool]:
    """Whether a value is a function of so many arguments."""
    return lambda value: callable(value) and len(inspect.signature(value).parameters) == count


def faults_by(wanted: Wanted) -> Callable[[ModuleType], str]:
    """What is wrong with a module in one line, empty when it holds what is wanted."""

    def faults(module: ModuleType) -> str:
        for name, will_do in wanted.items():
            if not hasattr(module, name):
                return f"it has no {name}"
            if not will_do(getattr(module, name)):
                return f"{name} will not do"
        return ""

    return faults


def names_of(package: str) -> list[str]:
    """Names of the modules right in a package of massprops, sorted; those that begin with _ are parts of others."""
    folder = import_module(package).__path__
    return sorted(entry.name for entry in pkgutil.iter_modules(folder) if not entry.name.startswith("_"))


def modules_of(package: str) -> list[ModuleType]:
    """The modules of `names_of`."""
    return [import_module(f"{package}.{name}") for name in names_of(package)]


def packaged(
    group: str, faults: Callable[[ModuleType], str], taken: Collection[str], key: str = "NAME"
) -> tuple[dict[str, ModuleType], dict[str, str]]:
    """The modules by their names, and what is wrong with those that are left out, by entry point.

    Args:
        group: of the entry points. faults: what is wrong with a module in one line, empty when nothing is.
        taken: names that are not free. key: which of a module's texts is its name.
    """
    modules: dict[str, ModuleType] = {}
    wrong: dict[str, str] = {}
    for point in entry_points(group=group):
        try:
            module = point.load()
            fault = faults(module)
        except Exception as error:  # noqa: BLE001  a package's own code
            wrong[point.name] = f"it cannot be loaded: {first_line(error)}"
            continue
        name = getattr(module, key, "")
        if not fault and (name in taken or name in modules):
            fault = f"its {key} {name!r} is taken"
        if fault:
            wrong[point.name] = fault
        else:
            modules[name] = module
    return modules, wrong
