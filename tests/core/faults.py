"""Makes the n-th change of the disk fail, or ends the process there as far as the disk can tell."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from massprops.core import files

KINDS = ("ENOSPC", "EIO", "kill")


class Killed(BaseException):
    """Stands for the end of the process: no clean-up reaches the disk after it."""


class Disk:
    """Counts the changes made through the file layer, and fails one.

    Attributes:
        count: changes so far; at: the one that fails, 0 for none; kind: of the failure.
    """

    def __init__(self, at: int = 0, kind: str = "kill") -> None:
        self.count, self.at, self.kind = 0, at, kind

    def __call__(self, verb: str, path: Path) -> None:
        self.count += 1
        if self.at and self.kind == "kill" and self.count >= self.at:
            raise Killed(f"{verb} {path}")
        if self.count == self.at:
            number = getattr(errno, self.kind)
            raise OSError(number, os.strerror(number), str(path))


@contextlib.contextmanager
def failing(at: int = 0, kind: str = "kill") -> Iterator[Disk]:
    """Within this, the file layer works on a disk that fails once; a death is caught here."""
    disk = Disk(at, kind)
    files.hook = disk
    try:
        yield disk
    except Killed:
        pass
    finally:
        files.hook = None


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder that is a result: what is kept of earlier ones, and the lock, are not."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_file() and not name.startswith((".massprops/lock", ".massprops/previous")):
            found[name] = path.read_bytes()
    return found


@contextlib.contextmanager
def quick_disk(folder: Path) -> Iterator[Path]:
    """A folder in memory where there is such a place: thousands of writes then do not wait for a busy disk."""
    memory = Path("/dev/shm")
    if not (memory.is_dir() and os.access(memory, os.W_OK)):
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="massprops-test-", dir=memory) as place:
        yield Path(place)
