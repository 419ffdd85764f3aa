"""Which parameters of an effect a table lists, in the terminal and on a page: those that the data show, and the names of the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

MOST = 15
"""Parameters of one effect that are listed, and names in one line."""


class Listed(NamedTuple):
    """The parameters that have a row, how many more the data show, and the others in words, empty where there are none."""

    rows: list[str]
    more: int
    hidden: str


def listed(values: Mapping[str, float | None]) -> Listed:
    """Of parameters by name, None for those that the data do not show."""
    shown = [name for name, value in values.items() if value is not None]
    hidden = [name for name, value in values.items() if value is None]
    hidden_text = ", ".join(hidden) if len(hidden) <= MOST else f"{len(hidden)} of {len(values)} parameters"
    return Listed(shown[:MOST], max(0, len(shown) - MOST), hidden_text)
