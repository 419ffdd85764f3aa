"""Tables for the terminal."""

from __future__ import annotations

import textwrap
from typing import Any

from massprops.campaigns.table import HEAD, left_out, percentile_rows
from massprops.core.text import table

WIDTH = 120


def text_of(document: dict[str, Any]) -> str:
    """The tables of a campaign: its kind's own, then percentiles of every column, then what failed."""
    parts = [own_table(kind_table) for kind_table in document["tables"]]
    if not parts:
        parts = [_percentiles(document)]
    if document["failures"]:
        counts = ", ".join(f"{count} × {error}" for error, count in document["failures"].items())
        parts.append(f"failed: {document['failed']} of {document['done']} runs: {counts}")
    return "\n\n".join(part for part in parts if part)


def own_table(own: dict[str, Any]) -> str:
    """`title`, `columns`, `rows`, `notes` as text."""
    rows = [[cell_text(c) for c in row] for row in own["rows"]]
    lines = [str(own["title"]), *folded([str(c) for c in own["columns"]], rows)]
    for note in own.get("notes", ()):
        lines += textwrap.wrap(str(note), WIDTH, initial_indent="  ", subsequent_indent="    ")
    return "\n".join(lines)


def cell_text(cell: Any) -> str:
    """A table's cell for people."""
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.4g}"
    return str(cell)


def folded(head: list[str], rows: list[list[str]]) -> list[str]:
    """A table, in several blocks under one another where it is wider than a terminal; each begins with the first column."""
    rows = [row + [""] * (len(head) - len(row)) for row in rows]
    wide = [2 + max(len(line[k]) for line in [head, *rows]) for k in range(len(head))]
    blocks: list[list[int]] = [[0]]
    for k in range(1, len(head)):
        if len(blocks[-1]) > 1 and sum(wide[i] for i in blocks[-1]) + wide[k] > WIDTH:
            blocks.append([0])
        blocks[-1].append(k)
    lines = []
    for block in blocks:
        lines += ([""] if lines else []) + table([head[k] for k in block], [[row[k] for k in block] for row in rows])
    return lines


def _percentiles(document: dict[str, Any]) -> str:
    blocks = [
        "\n".join([name, *table(HEAD, [[cell_text(c) for c in row] for row in rows])])
        for name, rows in percentile_rows(document)
    ]
    return "\n\n".join([*blocks, *filter(None, [left_out(document)])])
