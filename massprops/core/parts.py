"""Finished parts of a long computation, kept until all of it is done. After a kill the next run continues from them."""

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
        folder: where they are kept; None keeps nothing. Its name identifies what the parts are made from.
        prefix: of the name of each.
        damaged: names of parts whose files were changed since they were written; these parts are made again.
    """

    def __init__(self, folder: Path | None = None, prefix: str = "") -> None:
        self.folder, self.prefix = folder, prefix
        self.damaged: list[str] = []

    def within(self, name: str) -> Parts:
        """The store of one piece of this computation, for pieces that are done several times with other data."""
        inner = Parts(self.folder, f"{self.prefix}{name}: ")
        inner.damaged = self.damaged
        return inner

    def made(self, name: str, make: Callable[[], Arrays]) -> Arrays:
        """A part: read if it was finished before, else made now. Threads may ask for different parts at the same time.

        Args:
            name: of the part; any text.
            make: computes its arrays.
        """
        if self.folder is None:
            return make()
        name = self.prefix + name
        path = self.folder / hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:24]
        arrays = self._read(name, path)
        if arrays is None:
            arrays = make()
            with contextlib.suppress(OSError):  # what cannot be kept costs time, if anything
                make_folder(self.folder)
                write_whole(path, _packed(arrays))
        return arrays

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
