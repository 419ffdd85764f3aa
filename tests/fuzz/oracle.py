"""What must hold for any input: an answer or one clear line, little time and memory, nothing left behind."""

from __future__ import annotations

import contextlib
import io
import os
import re
import resource
import signal
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

from massprops.errors import MasspropsError

from .targets import Target, _write

MOST_CPU_S = 10.0
MOST_BYTES = 1_000_000_000
LONGEST_LINE = 400


@contextlib.contextmanager
def _limits() -> Iterator[None]:
    """At most ten seconds of this process' own time, whatever else the machine does, and a gigabyte more memory."""

    def stop(number: int, frame: object) -> None:
        raise TimeoutError(f"more than {MOST_CPU_S:.0f} s")

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    old = signal.signal(signal.SIGPROF, stop)
    resource.setrlimit(resource.RLIMIT_AS, (pages * os.sysconf("SC_PAGE_SIZE") + MOST_BYTES, before[1]))
    signal.setitimer(signal.ITIMER_PROF, MOST_CPU_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.signal(signal.SIGPROF, old)


@contextlib.contextmanager
def _native(said: io.StringIO) -> Iterator[None]:
    """What native code prints on the real standard error is part of what is said."""
    real = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(real, 2)
            os.close(real)
            file.seek(0)
            said.write("".join(f"native: {line}\n" for line in file.read().decode(errors="replace").splitlines()))


def fault(target: Target, folder: Path, name: str, data: bytes) -> str:
    """What is wrong with how the target takes this input: empty when nothing is, else one line with the place."""
    _write(folder, name, data)
    before = sorted(folder.rglob("*"))
    said = io.StringIO()
    try:
        with (
            warnings.catch_warnings(),
            _limits(),
            _native(said),
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(said),
        ):
            warnings.simplefilter("ignore")
            target.read(folder, name)
    except MasspropsError as error:
        line = str(error)
        if "\n" in line or len(line) - len(str(folder)) > LONGEST_LINE or not line.isprintable():
            return f"message of {len(line)} characters: {line[:200]!r}"
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)
        own = [f for f in place if "massprops" in f.filename and "/tests/" not in f.filename] or place
        return f"{type(error).__name__} at {Path(own[-1].filename).name}:{own[-1].lineno} ({str(error)[:80]!r})"
    if re.search(
        r"Traceback|unexpected \w*(Error|Exception|Interrupt)|bug of massprops|Warning:|native:", said.getvalue()
    ):
        return f"said {said.getvalue().strip().splitlines()[-1][:200]!r}"
    if sorted(folder.rglob("*")) != before:
        return "files were left behind"
    return ""
