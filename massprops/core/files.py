"""The file layer: every change that massprops makes to a disk goes through the few functions here.

Writing is whole or not at all, lands on regular files only, and follows no link. `hook` lets a test make the n-th
change fail, or kill the process there.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from massprops.core.log import log
from massprops.errors import InputError

hook: Callable[[str, Path], None] | None = None
"""Called as `hook(verb, path)` before each mkdir, write, fsync, rename and remove; an exception stands for its failure."""


def _step(verb: str, path: Path) -> None:
    if hook is not None:
        hook(verb, path)


def make_folder(path: Path) -> None:
    """`mkdir -p`."""
    if not path.is_dir():
        _step("mkdir", path)
        path.mkdir(parents=True, exist_ok=True)


def rename(source: Path, target: Path) -> None:
    """Puts `source` in the place of `target` at once."""
    _step("rename", target)
    source.replace(target)


def remove(path: Path) -> None:
    """Removes a file or link that may be absent."""
    if os.path.lexists(path):
        _step("remove", path)
        path.unlink(missing_ok=True)


def remove_folder(path: Path) -> None:
    """Removes a folder of massprops' own, as far as it can."""
    if path.is_symlink():
        path.unlink(missing_ok=True)
    elif path.is_dir():
        _step("remove", path)
        shutil.rmtree(path, ignore_errors=True)


def refuse_special(path: Path) -> None:
    """Only a regular file is ever replaced: a link leads elsewhere, a device is nothing to replace.

    Raises:
        InputError: there is something else.
    """
    try:
        mode = path.lstat().st_mode
    except OSError:
        return
    if not stat.S_ISREG(mode):
        kinds = ((stat.S_ISLNK, "a link"), (stat.S_ISDIR, "a folder"))
        kind = next((word for test, word in kinds if test(mode)), "a device or pipe")
        raise InputError(f"{path}: is {kind}, and only a regular file is written: choose another place with -o")


def write_whole(path: Path, content: str | bytes, by_way_of: Path | None = None) -> None:
    """Writes to a temporary name, then renames: a reader never sees half a file.

    Args:
        path: what to write.
        content: of the file; text as UTF-8.
        by_way_of: folder of the temporary file, on the same disk; the file's own folder by default.

    Raises:
        InputError: a link, folder or device stands there.
        OSError: the disk refuses; the old file is as it was.
    """
    refuse_special(path)
    data = content.encode() if isinstance(content, str) else content
    temporary = (by_way_of or path.parent) / f".{path.name}.{os.getpid()}.tmp"
    try:
        _step("write", path)
        handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0), 0o666)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            _step("fsync", path)
            os.fsync(file.fileno())
        rename(temporary, path)
        log.debug("wrote %s, %d bytes", path, len(data))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        remove(temporary)


def replace_folder(source: Path, target: Path) -> None:
    """Puts `source` in the place of `target`, whose old content goes away after the change.

    For folders of massprops' own; what a user may have put his hand on goes through `outputs`.
    """
    old = target.with_name(f".{target.name}.{os.getpid()}.old")
    if target.exists():
        rename(target, old)
    rename(source, target)
    remove_folder(old)


def plain(value: Any) -> Any:
    """`value` as what JSON and YAML know: numpy numbers, arrays, paths and tuples turned into it, NaN and infinity into
    None, and bytes of names that are no UTF-8 into codes."""
    if isinstance(value, dict):
        return {plain(str(k)): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, str | Path):
        text = str(value)
        return text if text.isascii() else text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(content: Any) -> str:
    """A JSON document as it is written."""
    return json.dumps(plain(content), indent=2, allow_nan=False) + "\n"


def write_json(path: Path, content: Any) -> None:
    """A JSON file, written whole."""
    write_whole(path, json_text(content))


def hash_of(value: Any) -> str:
    """sha256 of a value's JSON."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()


def hash_file(path: Path) -> str:
    """sha256 of a file's bytes.

    Raises:
        OSError: it cannot be read, or is no regular file.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise OSError(22, "not a regular file", str(path))
        return hashlib.file_digest(file, "sha256").hexdigest()


def files_below(folder: Path) -> Iterator[str]:
    """Names of all files below a folder, relative, in order; links to folders are files here, and not followed."""
    for place, folders, names in os.walk(folder):
        for name in sorted([*names, *(f for f in folders if os.path.islink(os.path.join(place, f)))]):  # noqa: PTH114, PTH118
            yield os.path.relpath(os.path.join(place, name), folder)  # noqa: PTH118
        folders.sort()


def hash_tree(folder: Path) -> str | None:
    """sha256 over names and contents of everything below a folder; None where it is not there or cannot be read."""
    if not folder.is_dir() or folder.is_symlink():
        return None
    total = hashlib.sha256()
    try:
        for name in files_below(folder):
            path = folder / name
            content = f"-> {path.readlink()}" if path.is_symlink() else hash_file(path)
            total.update(f"{name}\0{content}\n".encode("utf-8", "surrogateescape"))
    except OSError:
        return None
    return total.hexdigest()
