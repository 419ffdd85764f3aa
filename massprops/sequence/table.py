"""One `data.csv`: named columns in, arrays out, bad rows counted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from massprops.errors import InputError

LARGEST_FILE = 2_000_000_000
"""Bytes: a larger table is not a sequence of this kind, and is refused before memory is taken."""


def column_name(text: str) -> str:
    """`w_x [rad s^-1]` to `w_x`."""
    return text.split("[")[0].strip().lstrip("#").strip()


def read_table(path: Path, columns: tuple[str, ...], text: tuple[str, ...] = ()) -> tuple[dict[str, np.ndarray], int]:
    """Reads the named columns.

    The header's names decide where a column is; a file without a header is taken in the documented order.
    Rows with a missing, unreadable, infinite or NaN value in a wanted column are left out.

    Args:
        path: the file.
        columns: names wanted; `timestamp` is integer nanoseconds.
        text: which of them are text.

    Returns:
        arrays by name (`timestamp` int64, text as a list of str in an object-free `U` array, the rest float64), and
        the number of rows left out.

    Raises:
        InputError: no such file, a file too large, or a wanted column missing from the header.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(f"{path}: {path.stat().st_size / 1e9:.1f} GB is too large for a sequence table")
    place = {name: i for i, name in enumerate(columns)}
    values: dict[str, list] = {name: [] for name in columns}
    left_out = 0
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(file):
                line = line.strip()
                if not line:
                    continue
                if line.startswith("#") or (number == 0 and not line[0].isdigit() and line[0] not in "-+."):
                    names = [column_name(cell) for cell in line.split(",")]
                    if number == 0:
                        missing = [name for name in columns if name not in names]
                        if missing:
                            raise InputError(
                                f"{path}: header has no column {', '.join(missing)}; it has {', '.join(names)}"
                            )
                        place = {name: names.index(name) for name in columns}
                    continue
                row = _parse(line.split(","), place, text)
                if row is None:
                    left_out += 1
                    continue
                for name, value in row.items():
                    values[name].append(value)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    kinds = {name: np.str_ if name in text else np.int64 if name == "timestamp" else np.float64 for name in columns}
    return {name: np.array(values[name], dtype=kinds[name]) for name in columns}, left_out


def _parse(cells: list[str], place: dict[str, int], text: tuple[str, ...]) -> dict | None:
    row: dict = {}
    for name, i in place.items():
        if i >= len(cells):
            return None
        cell = cells[i].strip()
        if name in text:
            row[name] = cell
            continue
        try:
            value = int(cell) if name == "timestamp" else float(cell)
        except ValueError:
            return None
        if name == "timestamp" and not -(2**62) < value < 2**62:
            return None
        if not math.isfinite(value):
            return None
        row[name] = value
    return row


def table_text(header: str, rows: list[str]) -> str:
    """A `data.csv` with its header line."""
    return header + "\n" + "".join(row + "\n" for row in rows)
