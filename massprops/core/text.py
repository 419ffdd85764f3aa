"""Text of unknown origin made safe for a terminal."""

from __future__ import annotations

import unicodedata


def clean(text: str) -> str:
    """`text` without control sequences and characters that cannot be printed.

    File names and table cells come from outside. Their control characters, escape sequences, marks that change the
    direction of writing, and bytes that are not UTF-8 are shown as codes. Line ends and tabs stay.
    """
    return "".join(c if c in "\n\t" or unicodedata.category(c) not in HIDDEN else _code(c) for c in text)


HIDDEN = ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")
"""Unicode categories of characters that show nothing, or do something else than show."""


def _code(character: str) -> str:
    number = ord(character)
    if 0xDC80 <= number <= 0xDCFF:  # a byte of a name that is no UTF-8
        return f"\\x{number - 0xDC00:02x}"
    return f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}"


def counted(number: int, one: str, many: str) -> str:
    """A number with the words that go with it: "1 image was", "2 images were"."""
    return f"{number} {one if number == 1 else many}"


def clock(seconds: float) -> str:
    """A duration as text."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    if seconds < 3600:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
