"""One `data.csv`: named columns in, arrays out, bad rows counted."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np

from massprops.documents.loading import excerpt
from massprops.documents.tables import Column, Table
from massprops.errors import InputError
from massprops.memory import refuse_beyond

LARGEST_FILE = 2_000_000_000
"""Bytes: a larger table is not a sequence of this kind, and is refused before memory is taken."""
LONGEST_LINE = 100_000
LARGEST_STAMP = 2**62
FASTEST_HZ = 1e7
"""Rows a second that no sensor gives: gyroscopes reach 1e5, high-speed cameras 1e6. Seconds read as nanoseconds give 1e9."""
LONGEST_S = 3.2e8
"""Ten years: a record that spans more stands on two clocks."""
LONGEST_GAP = 1000.0
"""A gap as many times longer than all the rest of the record together parts two clocks."""


@dataclass(frozen=True)
class Rows:
    """What was read: arrays by column name, their line numbers in the file, rows left out, and the first line of them."""

    columns: dict[str, np.ndarray]
    lines: np.ndarray
    left_out: int = 0


def read_table(path: Path, table: Table) -> Rows:
    """Reads the columns of a table.

    The header's names decide where a column is and its units what it is multiplied by; a file without a header is
    taken in the documented order and units. Cells are parted by commas, or by semicolons or tabs when the first line
    has no comma. Rows with a missing, unreadable, infinite or NaN value in a wanted column are left out.

    Returns:
        arrays by name: `timestamp` int64 [ns], text as a `U` array, the rest float64 in documented units.

    Raises:
        InputError: no such file, a file too large or not text, a wanted column missing from the header or named twice,
            a unit that is not known, or rows of which none can be read.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(
            f"{path}: {path.stat().st_size / 1e9:.1f} GB is too large for a sequence table, of which at most "
            f"{LARGEST_FILE / 1e9:.1f} GB are read: cut the record"
        )
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline=None) as file:
            return _read(path, table, enumerate(_lines(path, file), 1))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _lines(path: Path, file: Iterator[str]) -> Iterator[str]:
    for line in file:
        if len(line) > LONGEST_LINE:
            raise InputError(f"{path}: a line of more than {LONGEST_LINE} characters, so no table: save it as CSV")
        if "\0" in line:
            raise InputError(f"{path}: not plain text (UTF-16 or binary): save it as CSV in UTF-8")
        yield line.strip()


def _read(path: Path, table: Table, lines: Iterator[tuple[int, str]]) -> Rows:
    parsers, between = None, ","
    stores = [_store(c) for c in table.columns]
    at: array[int] = array("q")
    left_out, first_bad, refused = 0, 0, ""
    for number, line in lines:
        if not line:
            continue
        if line.startswith("#") or (parsers is None and not re.match(r"[-+.\d]", line)):
            if any(_named(cell, c) for cell in _cells(line, _between(line)) for c in table.columns[:1]):
                if parsers is not None:
                    raise InputError(f"{path}: line {number}: a second header: give each table a file of its own")
                between = _between(line)
                parsers = _columns(path, table, _cells(line, between))
            elif parsers is None:
                # a remark above the header; when no header follows it was meant as one
                refused = refused or line
                if not line.startswith("#"):
                    break
            continue
        if parsers is None:
            if refused:
                break
            between = _between(line)
            parsers = [(i, _parser(c, 1.0)) for i, c in enumerate(table.columns)]
        if not len(at):
            _refuse_large(path, table, len(line) + 1)
        cells = line.split(between)
        try:
            row = [parse(cells[i].strip()) for i, parse in parsers]
        except (ValueError, IndexError, InvalidOperation, OverflowError):
            left_out, first_bad = left_out + 1, first_bad or number
            continue
        at.append(number)
        for store, value in zip(stores, row, strict=True):
            store.append(value)
    if parsers is None and refused:
        _columns(path, table, _cells(refused, _between(refused)))
    if left_out and not len(at):
        raise InputError(
            f"{path}: none of its {left_out} rows can be read; the first is line {first_bad}: give {table.header}"
        )
    kinds = [np.str_ if c.text else np.int64 if c.name == "timestamp" else np.float64 for c in table.columns]
    arrays = {c.name: np.array(s, dtype=k) for c, s, k in zip(table.columns, stores, kinds, strict=True)}
    return Rows(arrays, np.array(at, np.int64), left_out)


def _between(line: str) -> str:
    """What parts the cells of a line."""
    return next((c for c in ",;\t" if c in line), ",")


def _cells(line: str, between: str) -> list[str]:
    return [cell.strip(' "').lstrip("#").strip() for cell in line.lstrip("#").split(between)]


def _name(cell: str) -> str:
    """`w_x [rad s^-1]` to `w_x`."""
    return cell.split("[")[0].strip()


def _unit(cell: str) -> str | None:
    """`w_x [rad s^-1]` to `rad s^-1`; None without brackets."""
    bracketed = re.search(r"\[(.*)\]", cell)
    return None if bracketed is None else bracketed.group(1).strip()


def _named(cell: str, column: Column) -> bool:
    return _name(cell).casefold() in {n.casefold() for n in (column.name, *column.others)}


def _columns(path: Path, table: Table, cells: list[str]) -> list[tuple[int, Callable[[str], object]]]:
    """Where each column is and how its cells are read.

    Raises:
        InputError: a column missing or named twice, or a unit that is not known.
    """
    places, missing = [], []
    for column in table.columns:
        matching_cells = [i for i, cell in enumerate(cells) if _named(cell, column)]
        if not matching_cells:
            missing.append(column.name)
            continue
        if len(matching_cells) > 1:
            raise InputError(f"{path}: header names the column {column.name} {len(matching_cells)} times")
        unit = None if column.text else _unit(cells[matching_cells[0]])
        factor = column.factor(unit)
        if factor is None:
            raise InputError(
                f"{path}: column {column.name}: unit [{excerpt(unit or '', 30)}] is not known; give it in [{column.unit}]"
            )
        places.append((matching_cells[0], _parser(column, factor)))
    if missing:
        raise InputError(
            f"{path}: header has no column {', '.join(missing)}; it has {excerpt(', '.join(map(_name, cells)), 100)}"
        )
    return places


def _parser(column: Column, factor: float) -> Callable[[str], object]:
    """Reads one cell; raises ValueError where it cannot."""
    if column.text:
        return lambda cell: cell
    if column.name == "timestamp":
        return _stamp if factor == 1.0 else lambda cell: _stamp(int((Decimal(cell) * int(factor)).to_integral_value()))
    low, high = column.low, column.high

    def number(cell: str) -> float:
        value = float(cell) * factor
        if not math.isfinite(value) or not low <= value <= high:
            raise ValueError
        return value

    return number


def _stamp(cell: str | int) -> int:
    if isinstance(cell, str) and len(cell) > 24:
        raise ValueError
    value = int(cell)
    if not -LARGEST_STAMP < value < LARGEST_STAMP:
        raise ValueError
    return value


def _store(column: Column) -> list[Any] | array[Any]:
    return [] if column.text else array("q" if column.name == "timestamp" else "d")


def _refuse_large(path: Path, table: Table, line: int) -> None:
    """Refuses a table that does not fit into memory, before its rows are read: 8 bytes per cell, twice at the end."""
    rows = path.stat().st_size / max(line / 2, 2.0)
    cells = sum(60 if c.text else 8 for c in table.columns) + 8
    refuse_beyond(2 * cells * rows, f"{path}: about {rows:.2g} rows", "shorten the record")


def check_times(path: Path, stamp: np.ndarray, lines: np.ndarray) -> None:
    """Refuses times that cannot belong to one record.

    Args:
        path: for messages. stamp: (n,) int64 [ns], ascending. lines: (n,) where each stands in the file.

    Raises:
        InputError: a row on another clock than the rest, a span of more than `LONGEST_S`, or rows closer together than
            `FASTEST_HZ`.
    """
    if len(stamp) < 2:
        return
    gaps = np.diff(stamp).astype(float)
    widest = int(np.argmax(gaps))
    rest = float(stamp[-1] - stamp[0]) - gaps[widest]
    alone = gaps[widest] > LONGEST_GAP * max(rest, 1e9)
    if alone and len(stamp) > 2 or float(stamp[-1]) - float(stamp[0]) > LONGEST_S * 1e9:
        strange = lines[0] if widest < len(stamp) / 2 else lines[widest + 1]
        raise InputError(
            f"{path}: line {strange}: its time is {gaps[widest] * 1e-9:.4g} s from the other rows': bring all rows to one "
            "clock, or remove it"
        )
    distinct = gaps[gaps > 0]
    if len(distinct) > 1 and float(np.median(distinct)) < 1e9 / FASTEST_HZ:
        raise InputError(
            f"{path}: rows lie {np.median(distinct):.3g} ns apart: give timestamps in nanoseconds, or their unit in the "
            "header, as [s]"
        )


def table_text(header: str, rows: list[str]) -> str:
    """A `data.csv` with its header line."""
    return header + "\n" + "".join(row + "\n" for row in rows)


def stamped_table(header: str, stamp: np.ndarray, values: np.ndarray, digits: int = 17) -> str:
    """A `data.csv` of rows (n, k) with their timestamps (n,) [ns] first."""
    listed = zip(stamp.tolist(), values.tolist(), strict=True)
    return table_text(header, [",".join([str(t), *(f"{v:.{digits}g}" for v in row)]) for t, row in listed])
