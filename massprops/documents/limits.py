"""What a document of unknown origin may hold at most, and how its values are shown in messages."""

from __future__ import annotations

from typing import Any

MOST_VALUES = 100_000
"""Values of a document with every alias written out."""
DEEPEST = 40
"""Levels of nesting; our own documents have at most 7."""
LARGEST_WHOLE = 2**63 - 1


def excerpt(value: Any, most: int = 60) -> str:
    """A value for a message: one short line without characters that steer a terminal."""
    text = value if isinstance(value, str) else str(value) if isinstance(value, Exception) else _brief(value, most)
    text = "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))
    return text if len(text) <= most else text[: most - 1] + "…"


def _brief(value: Any, most: int) -> str:
    """`repr` of the beginning of a value only, since all of it may be long."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_brief(v, most) for v in value[:8]) + (", …" if len(value) > 8 else "") + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: …" for k in list(value)[:4]) + "}"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > LARGEST_WHOLE:
        return "an integer of more than 64 bits"
    return repr(value[: most + 1] if isinstance(value, str | bytes) else value)
