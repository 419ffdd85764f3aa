"""How a long computation reports its progress."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""`progress(done, total, what)`: called often and cheaply by a stage."""


def silent(done: int, total: int, what: str = "") -> None:
    """Progress that is not shown, for notebooks and tests."""
