"""Finished parts of a long piece of work, kept until the whole is done: who is killed on the way goes on from there."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from massprops.core.files import make_folder, write_whole

if TYPE_CHECKING:
    import numpy as np

Arrays: TypeAlias = "dict[str, np.ndarray]"
DIGEST = 32
"""Bytes of sha256 before the arrays in a part's file."""


class Parts:
    """The parts of one piece of work.

    Attributes:
        folder: where they are kept, None for nowhere. Its name says what the parts are made from.
        prefix: of the name of each.
        damaged: names of parts that were not as they had been written, and are made again.
    """

    def __init__(self, folder: Path | None = None, prefix: str = "") -> None:
        self.folder, self.prefix = folder, prefix
        self.damaged: list[str] = []

    def within(self, name: str) -> Parts:
        """The same place for a piece of this work that is done more than once, of other data each time."""
        inner = Parts(self.folder, f"{self.prefix}{name}: ")
        inner.damaged = self.damaged
        return inner

    def made(self, name: str, make: Callable[[], Arrays]) -> Arrays:
        """A part as it was made before, or as it is made now; threads may ask for different ones.

        Args:
            name: of the part; it may hold anything.
            make: gives its arrays, and nothing that is not kept.
        """
        if self.folder is None:
            return make()
        name = self.prefix + name
        path = self.folder / hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:24]
        found = self._read(name, path)
        if found is None:
            found = make()
            with contextlib.suppress(OSError):  # what cannot be kept costs time, if anything
                make_folder(self.folder)
                write_whole(path, _packed(found))
        return found

    def _read(self, name: str, path: Path) -> Arrays | None:
        import numpy as np

        if not path.is_file() or path.is_symlink():
            return None
        content = path.read_bytes()
        if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
            self.damaged.append(name)
            return None
        with np.load(io.BytesIO(content[DIGEST:]), allow_pickle=False) as arrays:
            return {key: arrays[key] for key in arrays}


def _packed(arrays: Arrays) -> bytes:
    import numpy as np

    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    content = file.getvalue()
    return hashlib.sha256(content).digest() + content
