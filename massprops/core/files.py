"""The file layer: every change that massprops makes to a disk goes through the few functions here.

A file is written completely or not at all. Only regular files are replaced, and links are not followed. A test can set
`hook` to make the n-th change fail, or to kill the process there.
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
    """Removes a folder that massprops made; what cannot be removed stays."""
    if path.is_symlink():
        path.unlink(missing_ok=True)
    elif path.is_dir():
        _step("remove", path)
        shutil.rmtree(path, ignore_errors=True)


def refuse_special(path: Path) -> None:
    """Refuses a path that is not a regular file: a link points elsewhere, and a device cannot be replaced.

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
        raise InputError(f"{path}: is {kind}, and only regular files can be written: choose another place with -o")


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


def write_image(path: Path, image: Any, options: tuple[int, ...] = ()) -> None:
    """An image in the format of the path's ending; `options` as for `cv2.imencode`.

    OpenCV says of a disk that refuses by a returned value at most, and leaves half an image.

    Raises:
        OSError: the disk refuses, or the image cannot be encoded.
    """
    import cv2

    good, data = cv2.imencode(path.suffix, image, list(options))
    if not good:
        raise OSError(22, "an image cannot be encoded", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.tobytes())


def replace_folder(source: Path, target: Path) -> None:
    """Puts `source` in the place of `target`, whose old content goes away after the change.

    For folders that only massprops uses. What a user may have changed goes through `outputs`.
    """
    old = target.with_name(f".{target.name}.{os.getpid()}.old")
    if target.exists():
        rename(target, old)
    rename(source, target)
    remove_folder(old)


def plain(value: Any) -> Any:
    """`value` in the types of JSON and YAML. numpy numbers, arrays, paths and tuples are converted. NaN and infinity become
    None. Bytes of a name that are not UTF-8 become codes."""
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
    """The text of a JSON document, as massprops writes it."""
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
    """Relative names of all files below a folder, sorted. A link to a folder counts as a file and is not followed."""
    for place, folders, names in os.walk(folder):
        for name in sorted([*names, *(f for f in folders if os.path.islink(os.path.join(place, f)))]):  # noqa: PTH114, PTH118
            yield os.path.relpath(os.path.join(place, name), folder)  # noqa: PTH118
        folders.sort()


def hash_tree(folder: Path) -> str | None:
    """sha256 over the names and contents of all files below a folder; None if the folder is missing or unreadable."""
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
