"""Text of unknown origin made safe for a terminal."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence


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


def table(
    head: Sequence[str], rows: Iterable[Sequence[str] | str], left: Sequence[int] = (0,), indent: int = 2
) -> list[str]:
    """Lines of a table: columns in line, those numbered in `left` to the left and the others to the right.

    A row may lack its last cells; one that is a string stands as it is, below the second column. Letters count as wide as a
    terminal shows them.
    """
    from rich.cells import cell_len
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    listed = [head, *rows]
    given = [[*row, *[""] * (len(head) - len(row))] for row in listed if not isinstance(row, str)]
    cells = [[" ".join(clean(c).split("\n")) for c in row] for row in given]
    grid = Table.grid(padding=(0, 2, 0, 0))
    for k, _ in enumerate(head):
        grid.add_column(justify="left" if k in left else "right", no_wrap=True)
    for row in cells:
        grid.add_row(*(Text(c, tab_size=1) for c in row))
    console = Console(width=sum(cell_len(c) + 2 for row in cells for c in row) + 1, color_system=None)
    drawn = iter(console.render_lines(grid, pad=False))
    below = " " * (indent + max(cell_len(row[0]) for row in cells) + 2)
    return [
        below + row if isinstance(row, str) else (" " * indent + "".join(s.text for s in next(drawn))).rstrip()
        for row in listed
    ]


def with_sigma(value: float | None, sigma: float | None, form: str = ".5f") -> str:
    """A value in this form with its 1-sigma, where it has one; `-` for none."""
    if value is None:
        return "-"
    return f"{value:{form}}" + (f" ±{sigma:.1g}" if sigma is not None else "")


def clock(seconds: float) -> str:
    """A duration as text."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    if seconds < 3600:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
