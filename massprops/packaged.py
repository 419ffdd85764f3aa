"""Modules that installed packages bring to a registry, by entry points."""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib.metadata import entry_points
from types import ModuleType

from massprops.effect_contract import first_line


def packaged(
    group: str, faults: Callable[[ModuleType], str], taken: Collection[str]
) -> tuple[dict[str, ModuleType], dict[str, str]]:
    """The modules by their `NAME`, and what is wrong with those that are left out, by entry point.

    Args:
        group: of the entry points. faults: what is wrong with a module in one line, empty when nothing is.
        taken: names that are not free.
    """
    found: dict[str, ModuleType] = {}
    wrong: dict[str, str] = {}
    for point in entry_points(group=group):
        try:
            module = point.load()
            fault = faults(module)
        except Exception as error:  # noqa: BLE001  a package's own code
            wrong[point.name] = f"it cannot be loaded: {first_line(error)}"
            continue
        if not fault and (module.NAME in taken or module.NAME in found):
            fault = f"its NAME {module.NAME!r} is taken"
        if fault:
            wrong[point.name] = fault
        else:
            found[module.NAME] = module
    return found, wrong
