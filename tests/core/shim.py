"""Commands on a disk whose n-th change fails, whatever process or library makes it: `shim.c` by LD_PRELOAD."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-c", "from massprops_cli.main import main; main()"]


@cache
def _built(folder: Path) -> Path:
    library = folder / "shim.so"
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("no C compiler for the library that makes writes fail")
    source = Path(__file__).with_name("shim.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    return library


class Faulty:
    """Runs commands with faults below one folder.

    Attributes:
        place: a scratch folder; count: changes that the last command made.
    """

    def __init__(self, place: Path) -> None:
        self.place, self.count = place, 0
        place.mkdir(exist_ok=True)
        self.library, self.counter, self.log = _built(place), place / "count", place / "log"
        self.trace = place / "trace"

    def __call__(
        self, folder: Path, arguments: list[str], at: int = 0, kind: str = "kill"
    ) -> subprocess.CompletedProcess[str]:
        """`massprops ARGUMENTS` with the `at`-th change below `folder` failing as `kind`; 0 for none."""
        self.counter.write_bytes(bytes(8))
        self.log.write_bytes(b"")
        self.trace.write_bytes(b"")
        environment = {
            **os.environ,
            "LD_PRELOAD": str(self.library),
            "SHIM_FOLDER": str(folder.resolve()),
            "SHIM_COUNTER": str(self.counter),
            "SHIM_AT": str(at),
            "SHIM_KIND": kind,
            "SHIM_LOG": str(self.log),
            "SHIM_TRACE": str(self.trace),
        }
        done = self._run(arguments, environment)
        self.count = int.from_bytes(self.counter.read_bytes(), sys.byteorder)
        return done

    def _run(self, arguments: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*COMMAND, *arguments],
            capture_output=True,
            text=True,
            errors="replace",
            env=environment,
            start_new_session=True,
            check=False,
        )

    def changes(self, folder: Path) -> list[tuple[int, str, str]]:
        """What the last command changed below a folder: number, verb and relative path of each change, in order."""
        rows = [line.split(" ", 2) for line in self.trace.read_text(errors="replace").splitlines()]
        place = str(folder.resolve())
        return sorted((int(n), verb, os.path.relpath(path, place)) for n, verb, path in rows)

    def loose(self, folder: Path) -> list[str]:
        """The files below a folder that the last command wrote and did not bring to the disk."""
        inodes: set[int] = set()
        for line in self.log.read_text().splitlines():
            what, inode = line.split()
            (inodes.add if what == "w" else inodes.discard)(int(inode))
        files = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.stat().st_ino in inodes)
        return [str(p.relative_to(folder)) for p in files]

    def cut_power(self, folder: Path, earlier: Sequence[str] = ()) -> list[str]:
        """Takes the data of every file that the last command did not bring to the disk, as a power cut may.

        The names stay: a file system may write a rename before the data of the file that is renamed.

        Args:
            folder: where the command wrote.
            earlier: files that earlier commands left loose; those that are still there go, too.

        Returns:
            the files that are empty now.
        """
        lost = sorted({*self.loose(folder), *(name for name in earlier if (folder / name).is_file())})
        for name in lost:
            os.truncate(folder / name, 0)
        return lost
