"""Child processes: they run no code from the current folder, and they end with their parent."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

PARENT = "MASSPROPS_PARENT"
"""The variable by which a child process learns who started it."""
ORPHANED = 143
"""Exit code of a process whose parent ended before it."""
LOOK_S = 0.2
"""How often a process looks for its parent where the kernel does not."""


def python_module(module: str, *arguments: str) -> list[str]:
    """A command line that runs a module; `-P` keeps the current folder out of the module search."""
    return [sys.executable, "-P", "-m", module, *arguments]


def child_environment(**more: str) -> dict[str, str]:
    """The environment of a child process that must find the same modules as this process.

    The current folder is left out of the module search, since an `av.py` or `random.py` of the user's may lie there,
    unless massprops itself lies there. The environment also names the parent; see `die_with_parent`.
    """
    here = os.path.realpath(Path.cwd())
    package_root = os.path.realpath(Path(__file__).parents[2])
    entries = [p for p in sys.path if p and (os.path.realpath(p) != here or here == package_root)]
    own_words = {"PYTHONPATH": os.pathsep.join(entries), "PYTHONSAFEPATH": "1", PARENT: str(os.getpid())}
    return {**os.environ, **own_words, **more}


def processors() -> int:
    """Number of processors that this process may use; on macOS, where this is not known, all of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def die_with_parent() -> None:
    """Makes this process end with its parent, so that a killed run leaves no process behind.

    On Linux the kernel does this, elsewhere a thread that checks. If the parent named by `child_environment` ended while
    this process was importing, this process ends at once.
    """
    parent = int(os.environ.pop(PARENT, os.getppid()))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    else:
        threading.Thread(target=_end_without, args=(parent,), daemon=True).start()
    if os.getppid() != parent:
        os._exit(ORPHANED)


def _end_without(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_S)
    os._exit(ORPHANED)


def is_alive(pid: int) -> bool:
    """Whether a process with this number runs on this machine."""
    try:
        os.kill(pid, 0)
    except (OSError, OverflowError) as error:
        return not isinstance(error, ProcessLookupError)
    return True


_muffling = threading.Lock()
_muffled: list[int] = []
"""The real standard error, once for each thread that keeps native code from it."""


@contextlib.contextmanager
def silenced_stderr() -> Iterator[None]:
    """Discards what native code prints on standard error, for the whole process while the context lasts.

    libjpeg, libpng and OpenCV print their own lines about damaged files; our error message says it in one line.
    """
    with _muffling:
        _muffled.append(_muffled[0] if _muffled else _redirected(2))
    try:
        yield
    finally:
        with _muffling:
            real = _muffled.pop()
            if not _muffled and real >= 0:
                os.dup2(real, 2)
                os.close(real)


@contextlib.contextmanager
def captured_output() -> Iterator[list[str]]:
    """Captures what libraries, native code too, print on both standard streams, for the whole process.

    Yields a list that holds the text after the context. Some libraries print on standard output, where a result belongs,
    what they miss when they are loaded.
    """
    printed_text: list[str] = []
    with tempfile.TemporaryFile() as file, _muffling:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or none
            sys.stdout.flush()
        reals = [(handle, _redirected(handle, file.fileno())) for handle in (1, 2)]
        printed = io.StringIO()
        try:
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
                yield printed_text
        finally:
            ctypes.CDLL(None).fflush(None)  # C keeps lines back where it does not write to a terminal
            for handle, real in reals:
                if real >= 0:
                    os.dup2(real, handle)
                    os.close(real)
            file.seek(0)
            printed_text.append(file.read().decode(errors="replace") + printed.getvalue())


def _redirected(handle: int, target: int | None = None) -> int:
    """Redirects a file handle to a target, or to nowhere; returns a copy of the old handle, or -1 if it was closed."""
    try:
        real = os.dup(handle)
    except OSError:
        return -1
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere if target is None else target, handle)
    os.close(nowhere)
    return real


def limit_memory() -> None:
    """Limits this process to the available memory, so that a too large array fails before the machine starts to swap.

    RLIMIT_DATA counts writable memory. RLIMIT_AS would count address space too, of which numba, open3d and every thread's
    stack reserve many times what they use.
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


def peak_memory_mb() -> float:
    """The most memory that this process has held [MiB].

    `getrusage` begins with what the process held that started this one, so it is asked only where nothing else tells.
    """
    import resource

    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return round(int(line.split()[1]) / 1024, 1)
    except (OSError, ValueError, IndexError):
        pass
    return round(
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10), 1
    )


def address_space_hint() -> str:
    """What to do about a limit on address space, for error messages; empty if there is no limit.

    Under such a limit libraries fail to load and threads fail to start, each with its own message.
    """
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return ""
    return f"; address space is limited to {limit / 1e9:.2g} GB (ulimit -v), of which libraries reserve more than they use: raise it"


def memory_there_is() -> int | None:
    """Memory of the machine or the container [bytes]; None if not known."""
    limits = []
    try:
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError):
        return None
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(int(Path(name).read_text()))
        except (OSError, ValueError):
            continue
    return min(v for v in limits if v > 0)
