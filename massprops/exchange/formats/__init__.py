"""One export format a file. A format declares

NAME: what `--to` takes.
SUFFIX: of the file.
NEEDS_METRES: whether a body in model units is refused.
MESHES: whether a visual and a collision mesh are written beside it and referenced by relative path.
FOLDER: True for a format of several files, which then lie in a folder of their own; may be left out.
render(body, meshes) -> str or bytes: the file's content, or of several files a dictionary by name; `meshes` maps "visual"
and "collision" to relative paths. Raises InputError where the body lacks what the format is about.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from types import ModuleType


def formats() -> dict[str, ModuleType]:
    """Every format of this folder by its name."""
    found = (import_module(f"{__name__}.{entry.name}") for entry in pkgutil.iter_modules(__path__))
    return {module.NAME: module for module in sorted(found, key=lambda module: module.NAME)}
