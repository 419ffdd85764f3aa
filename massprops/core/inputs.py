"""Hashes of inputs; images that an earlier stage wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from massprops.core.files import files_below, hash_file, hash_of, plain
from massprops.core.outputs import OWN
from massprops.core.processes import silenced_stderr
from massprops.errors import InputError


def read_image(path: Path, kind: int = 1) -> Any:
    """An image that an earlier stage wrote; `kind` 0 is grey, 1 colour.

    Raises:
        OSError: it cannot be read.
    """
    import cv2

    with silenced_stderr():
        image = cv2.imread(str(path), kind) if path.is_file() else None
    if image is None:
        raise OSError(5, "an image of an earlier stage cannot be read", str(path))
    return image


def hash_input(source: Path) -> dict[str, str]:
    """sha256 of a file, or of every file of a folder by relative name.

    The truth of a simulated sequence is not an input and is not opened. Neither is the record of what wrote the folder.

    A name that is not UTF-8 is written with the codes of its bytes.
    """
    if source.is_file():
        return {plain(source.name): hash_file(source)}
    names = [n for n in sorted(files_below(source)) if not {"truth", OWN} & set(Path(n).parts)]
    return {plain(n): hash_file(source / n) for n in names if (source / n).is_file()}


def key_of_source(source: Path, *more: Any) -> str:
    """Key of a result that depends on a file or folder, on further files (paths), and on settings (anything else)."""
    import massprops

    parts = [hash_input(p) if isinstance(p, Path) else p for p in (source, *more)]
    return hash_of([massprops.__version__, *parts])


def readable(path: Path) -> Path:
    """The path itself. A name that is not text is refused: native libraries cannot open it, and some crash.

    Raises:
        InputError: its name is not UTF-8.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: its name is not UTF-8: rename it") from None
    return path
