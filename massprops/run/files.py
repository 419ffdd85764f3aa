"""Whole-or-nothing writing, hashing and locking of a run folder."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from massprops.errors import InputError


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes to a temporary name in the same folder, then renames: a reader never sees half a file."""
    data = content.encode() if isinstance(content, str) else content
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def read_image(path: Path, kind: int = 1) -> Any:
    """An image that an earlier stage wrote; `kind` 0 is grey, 1 colour.

    Raises:
        OSError: it cannot be read.
    """
    import cv2

    image = cv2.imread(str(path), kind)
    if image is None:
        raise OSError(5, "an image of an earlier stage cannot be read", str(path))
    return image


def copy_whole(source: Path, target: Path) -> None:
    """Copies a file under a temporary name, then renames."""
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        shutil.copyfile(source, temporary)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def replace_folder(source: Path, target: Path) -> None:
    """Puts `source` in the place of `target`, whose old content goes away after the change."""
    old = target.with_name(f".{target.name}.{os.getpid()}.old")
    if target.exists():
        target.rename(old)
    source.rename(target)
    shutil.rmtree(old, ignore_errors=True)


def plain(value: Any) -> Any:
    """`value` with numpy numbers, arrays, paths and tuples as what JSON and YAML know; NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: Path, content: Any) -> None:
    """A JSON file, written whole."""
    write_whole(path, json.dumps(plain(content), indent=2, allow_nan=False) + "\n")


def hash_of(value: Any) -> str:
    """sha256 of a value's JSON."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()


def hash_input(source: Path) -> dict[str, str]:
    """sha256 of a file, or of every file of a folder by relative name.

    Truth beside a simulated sequence is no input, and is not opened.
    """
    if source.is_file():
        return {source.name: _hash_file(source)}
    files = sorted(p for p in source.rglob("*") if p.is_file() and "truth" not in p.relative_to(source).parts)
    return {str(p.relative_to(source)): _hash_file(p) for p in files}


def _hash_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def locked(run: Path) -> Iterator[None]:
    """Holds the run folder for this process; the lock goes with the process, however it ends.

    Raises:
        InputError: another process is at work in the folder, or it cannot be written.
    """
    import fcntl

    work = run / "work"
    try:
        work.mkdir(parents=True, exist_ok=True)
        file = (work / "lock").open("a+")
    except FileExistsError:
        raise InputError(f"{run}: is a file, not a folder: choose another place with -o") from None
    except OSError as error:
        raise InputError(f"{run}: cannot be written ({error.strerror}): choose another place with -o") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{run}: another massprops is at work in this folder: wait for it, or choose another -o"
            ) from None
        for stale in (*work.glob("*.tmp-*"), *work.glob(".*.old")):
            shutil.rmtree(stale, ignore_errors=True)
        yield
