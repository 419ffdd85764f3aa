"""`.npz` files of a run as input: damaged, empty or hollow ones are a `ValueError`, never something else."""

from __future__ import annotations

import contextlib
import errno
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

LARGEST_BYTES = 8_000_000_000
"""Of all arrays of a file. A dense cloud of 50 million points has 2 GB."""
LARGEST_PACKED = 500_000_000
"""Bytes, unpacked, of arrays that are compressed. massprops compresses none, and a megabyte may hold a thousand."""


@contextlib.contextmanager
def open_arrays(path: Path) -> Iterator[Any]:
    """As `np.load`, for a `with` statement; errors while an array is read are covered too.

    Raises:
        OSError: no such file, or not to be read.
        ValueError: damaged, with objects in it, or larger than it can be.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise ValueError(f"{path}: no regular file")
    try:
        with zipfile.ZipFile(path) as packed:
            _refuse_large(path, packed.infolist())
            for entry in packed.infolist():
                _refuse_hollow(packed, entry)
        with np.load(path, allow_pickle=False) as arrays:
            yield arrays
    except (EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, MemoryError) as error:
        raise ValueError(f"{path}: damaged ({type(error).__name__})") from None
    except OSError as error:
        if error.errno != errno.EINVAL:  # a place before the file's beginning, which a damaged directory names
            raise
        raise ValueError(f"{path}: damaged ({error.strerror})") from None


def _refuse_large(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    for limit, sizes in (
        (LARGEST_BYTES, [e.file_size for e in entries]),
        (LARGEST_PACKED, [e.file_size for e in entries if e.compress_type != zipfile.ZIP_STORED]),
    ):
        if sum(sizes) > limit:
            raise ValueError(f"{path}: {sum(sizes) / 1e9:.1f} GB of arrays in {path.stat().st_size / 1e6:.1f} MB")


def _refuse_hollow(packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> None:
    """An array whose header announces more than its bytes would take memory before it fails."""
    with packed.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    size = dtype.itemsize
    for length in shape:
        size *= int(length)
    if size > entry.file_size:
        raise ValueError(f"{entry.filename}: announces more than it holds")
