"""How curves look: one colour for each method in every chart, one kind of line for each component of a vector."""

from __future__ import annotations

from zlib import crc32

COLOURS = 8
"""Classes `s0` to `s7` of `style.css`."""
OWN = "own"
"""Class of the mesh, or of the truth: not of any method."""
DASHES = 3
"""Classes `d0` (solid) to `d2` of `style.css`."""


def method_style(name: str) -> str:
    """Class of a method's colour, the same in all charts of all pages.

    The first eight methods have a colour each, in the order of the catalogue. One that is not in it, as of a plugin that is
    no longer installed, has a colour by its name.
    """
    from massprops.estimators.methods import methods

    known = list(methods())
    return f"s{(known.index(name) if name in known else crc32(name.encode())) % COLOURS}"


def component_style(j: int) -> str:
    """Class of the line of a vector's component j: solid, dashed, dotted."""
    return f"d{j % DASHES}"
