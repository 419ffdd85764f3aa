"""Processes of massprops' own: started so that nothing in the current folder is run, ended with their parent."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path


def python_module(module: str, *arguments: str) -> list[str]:
    """A command line that runs a module; `-P` keeps the current folder out of the module search."""
    return [sys.executable, "-P", "-m", module, *arguments]


def child_environment(**more: str) -> dict[str, str]:
    """The environment of a child process, which finds the modules that this process finds.

    The current folder holds the user's files: an `av.py` or `random.py` among them is not ours to import. It is left
    out, unless massprops itself lies there.
    """
    here = os.path.realpath(Path.cwd())
    own = os.path.realpath(Path(__file__).parents[2])
    entries = [p for p in sys.path if p and (os.path.realpath(p) != here or here == own)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(entries), "PYTHONSAFEPATH": "1", **more}


def processors() -> int:
    """Processors that this process may use; on macOS, which does not say, those of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def die_with_parent() -> None:
    """Asks the kernel to end this process with its parent (Linux), so that a killed run leaves nothing at work."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


_muffling = threading.Lock()
_muffled: list[int] = []
"""The real standard error, once for each thread that keeps native code from it."""


@contextlib.contextmanager
def muffled() -> Iterator[None]:
    """Keeps what native code prints away from standard error, of the whole process while it lasts.

    libjpeg, libpng and OpenCV print lines of their own about damaged files; what is wrong is told by us, in one line.
    """
    with _muffling:
        _muffled.append(_muffled[0] if _muffled else _turned_away(2))
    try:
        yield
    finally:
        with _muffling:
            real = _muffled.pop()
            if not _muffled and real >= 0:
                os.dup2(real, 2)
                os.close(real)


@contextlib.contextmanager
def overheard() -> Iterator[list[str]]:
    """Keeps what libraries print, native code too, away from both standard streams, of the whole process while it lasts.

    Gives a list that holds what was printed, when it is over. Some libraries tell on standard output what they miss as
    they are loaded, where a result belongs.
    """
    said: list[str] = []
    with tempfile.TemporaryFile() as file, _muffling:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or none
            sys.stdout.flush()
        reals = [(handle, _turned_away(handle, file.fileno())) for handle in (1, 2)]
        printed = io.StringIO()
        try:
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
                yield said
        finally:
            ctypes.CDLL(None).fflush(None)  # C keeps lines back where it does not write to a terminal
            for handle, real in reals:
                if real >= 0:
                    os.dup2(real, handle)
                    os.close(real)
            file.seek(0)
            said.append(file.read().decode(errors="replace") + printed.getvalue())


def _turned_away(handle: int, target: int | None = None) -> int:
    """Leads a file handle nowhere, or to a target; a copy of what it was, or -1 where it was closed."""
    try:
        real = os.dup(handle)
    except OSError:
        return -1
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere if target is None else target, handle)
    os.close(nowhere)
    return real


def limit_memory() -> None:
    """Bounds this process to the memory there is, so that it is refused an array before the machine grinds to a halt.

    RLIMIT_DATA counts what can be written to; RLIMIT_AS would count address space too, of which numba, open3d and
    every thread's stack reserve many times what they use.
    """
    import resource

    limit = memory_there_is()
    if limit is None:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    for known in (soft, hard):
        if known != resource.RLIM_INFINITY:
            limit = min(limit, known)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


def address_space_hint() -> str:
    """What to do about a limit on address space, for a message of failure; empty without a limit.

    Under one, libraries cannot be loaded or threads not started, and each says so in words of its own.
    """
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return ""
    return f"; address space is limited to {limit / 1e9:.2g} GB (ulimit -v), of which libraries reserve more than they use: raise it"


def memory_there_is() -> int | None:
    """Bytes of memory of the machine, or of the container; None where that is not known."""
    found = []
    try:
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError):
        return None
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            found.append(int(Path(name).read_text()))
        except (OSError, ValueError):
            continue
    return min(v for v in found if v > 0)
