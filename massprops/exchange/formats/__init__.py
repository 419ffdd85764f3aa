"""One export format a file. A format declares

NAME: what `--to` takes.
SUFFIX: of the file.
NEEDS_METRES: whether a body in model units is refused.
MESHES: whether a visual and a collision mesh are written beside it and referenced by relative path.
FOLDER: True for a format of several files, which then lie in a folder of their own; may be left out.
render(body, meshes) -> str or bytes: the file's content, or of several files a dictionary by name; `meshes` maps "visual"
and "collision" to relative paths. Raises InputError where the body lacks what the format is about.

A file of this folder is a format; so is a module that an installed package names by an entry point of the group
`massprops.formats`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Protocol, cast

from massprops.exchange.body import Body
from massprops.packaged import Wanted, faults_by, is_flag, is_text, modules_of, packaged

WANTED: Wanted = {"NAME": is_text, "SUFFIX": is_text, "NEEDS_METRES": is_flag, "MESHES": is_flag, "render": callable}


class Format(Protocol):
    """What such a file holds; `FOLDER` may be left out."""

    NAME: str
    SUFFIX: str
    NEEDS_METRES: bool
    MESHES: bool

    def render(self, body: Body, meshes: Mapping[str, str]) -> str | bytes | dict[str, str | bytes]:
        """See the top of this file."""
        ...


@cache
def formats() -> dict[str, Format]:
    """Every format by its name."""
    by_name = {module.NAME: module for module in modules_of(__name__)}
    by_name |= packaged("massprops.formats", faults_by(WANTED), by_name)[0]
    return cast("dict[str, Format]", dict(sorted(by_name.items())))
