"""How long work says how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""`progress(done, total, what)`: called often and cheaply by a stage."""


def silent(done: int, total: int, what: str = "") -> None:
    """Progress that says nothing, for notebooks and tests."""
