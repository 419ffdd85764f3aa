"""Hashing of inputs, and reading of what an earlier step wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from massprops.core.files import files_below, hash_file, hash_of, plain
from massprops.core.outputs import OWN
from massprops.core.processes import muffled
from massprops.errors import InputError


def read_image(path: Path, kind: int = 1) -> Any:
    """An image that an earlier stage wrote; `kind` 0 is grey, 1 colour.

    Raises:
        OSError: it cannot be read.
    """
    import cv2

    with muffled():
        image = cv2.imread(str(path), kind) if path.is_file() else None
    if image is None:
        raise OSError(5, "an image of an earlier stage cannot be read", str(path))
    return image


def hash_input(source: Path) -> dict[str, str]:
    """sha256 of a file, or of every file of a folder by relative name.

    Truth beside a simulated sequence is no input, and is not opened; nor is the record of what wrote the folder.

    A name that is not UTF-8 is written with the codes of its bytes.
    """
    if source.is_file():
        return {plain(source.name): hash_file(source)}
    names = [n for n in sorted(files_below(source)) if not {"truth", OWN} & set(Path(n).parts)]
    return {plain(n): hash_file(source / n) for n in names if (source / n).is_file()}


def key_of_source(source: Path, *more: Any) -> str:
    """Key of what is made from a file or folder, and from further files (paths) and settings (anything else)."""
    import massprops

    parts = [hash_input(p) if isinstance(p, Path) else p for p in (source, *more)]
    return hash_of([massprops.__version__, *parts])


def readable(path: Path) -> Path:
    """The path, refused where its name is not text: native libraries cannot open it, and some crash over it.

    Raises:
        InputError: its name is not UTF-8.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: its name is not UTF-8: rename it") from None
    return path
