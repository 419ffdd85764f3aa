"""A user's own effect file: tried in a process of its own, with limits on time and memory, before it is used.

    python -P -m massprops.effect_file FILE RESULT

tries a file and writes what is wrong with it, nothing if all is well, into RESULT.
"""

from __future__ import annotations

import contextlib
import importlib.util
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType, ModuleType

from massprops.effect_contract import faults, first_line
from massprops.effects import add, remove
from massprops.errors import InputError, NotPossible

SECONDS = 60.0
"""By the clock that the trial of a file may take; importing numpy on a busy machine takes some of it."""
USE_SECONDS = 60.0
"""By the clock that one call may take later."""
LOOKS = 10
"""At the stack in that time."""
CPU_SECONDS = 20
"""Processor time that the trial of an effect file may take."""
MEMORY_BYTES = 2 * 10**9
LARGEST_BYTES = 1_000_000
PREFIX = "massprops_effect_of_user_"


def read_effect(path: str | Path, seconds: float = SECONDS) -> ModuleType:
    """The effect of a file, tried first.

    Raises:
        InputError: no such file, or it is no effect, raises, takes too long or too much memory.
    """
    path = Path(path)
    if not path.is_file() or path.suffix != ".py":
        raise InputError(f"--effect {path}: no such Python file; 'massprops effects' says what one holds")
    if path.stat().st_size > LARGEST_BYTES:
        raise InputError(f"--effect {path}: too large; an effect file has at most {LARGEST_BYTES / 1e6:.0f} MB")
    wrong = _tried_apart(path, seconds)
    if wrong:
        raise InputError(f"--effect {path}: {wrong}")
    try:
        return _imported(path)
    except Exception as error:  # noqa: BLE001  a user's own code
        raise InputError(f"--effect {path}: {first_line(error)}") from None


@contextlib.contextmanager
def with_effects(paths: Sequence[str | Path]) -> Iterator[list[ModuleType]]:
    """The effects of these files known to this process, for as long as the context lasts.

    Raises:
        InputError: a file is no effect, or has the name of another.
        NotPossible: one of the files' own code failed while it was used.
    """
    effects: list[ModuleType] = []
    try:
        for path in paths:
            effect = read_effect(path)
            if any(effect.NAME == other.NAME for other in effects):
                raise InputError(f"--effect {path}: another file has the NAME {effect.NAME!r} too: rename one of them")
            add(effect)
            effects.append(effect)
        try:
            with _each_call_ends({str(effect.__file__) for effect in effects}, USE_SECONDS):
                yield effects
        except (InputError, NotPossible):
            raise
        except Exception as error:
            files = {frame.filename for frame in traceback.extract_tb(error.__traceback__)}
            for effect in effects:
                if effect.__file__ in files:
                    raise NotPossible(
                        f"effect {effect.NAME} failed: {first_line(error)}: correct {effect.__file__}"
                    ) from None
            raise
    finally:
        for effect in effects:
            remove(effect.NAME)


@contextlib.contextmanager
def _each_call_ends(files: set[str], seconds: float) -> Iterator[None]:
    """Raises an error within a call into one of the files that takes longer than this by the clock.

    A timer looks at the stack from time to time, so a call costs nothing. Without one, outside the main thread, nothing is watched.
    """
    if not files or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return
    last: FrameType | None = None
    since = 0.0

    def look(_: int, frame: FrameType | None) -> None:
        nonlocal last, since
        call = None
        while frame is not None:
            call = frame if frame.f_code.co_filename in files else call
            frame = frame.f_back
        if call is None or call is not last:
            last, since = call, time.monotonic()
        elif time.monotonic() - since > seconds:
            raise RuntimeError(f"a call of it takes more than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, seconds / LOOKS, seconds / LOOKS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _tried_apart(path: Path, seconds: float) -> str:
    """What is wrong with a file, by its trial in a child process."""
    import subprocess

    from massprops.core.processes import child_environment, python_module

    with tempfile.TemporaryDirectory(prefix="massprops-effect-") as folder:
        result = Path(folder) / "result.txt"
        try:
            done = subprocess.run(
                python_module("massprops.effect_file", str(path.resolve()), str(result)),
                env=child_environment(OPENBLAS_NUM_THREADS="1"),
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder,
                timeout=seconds, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return f"it took more than {seconds:g} s when tried: make it faster, or look for a loop that does not end"
        if result.is_file() and done.returncode == 0:
            return result.read_text(errors="replace")[:300]
        return (
            f"it gave no result when tried (exit {done.returncode}): it takes more than {CPU_SECONDS} s or "
            f"{MEMORY_BYTES / 1e9:.0f} GB, or ends the process"
        )


def _imported(path: Path) -> ModuleType:
    """The module of a file, under a name of its own."""
    name = PREFIX + "".join(c if c.isalnum() else "_" for c in path.stem)
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise ImportError("not a Python file")
    module = importlib.util.module_from_spec(spec)
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = before
    return module


def _main(path: Path, result: Path) -> None:
    import resource

    from massprops.core.processes import die_with_parent

    die_with_parent()
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))
    try:
        wrong = faults(_imported(path))
    except (Exception, SystemExit) as error:  # noqa: BLE001  a user's own code
        wrong = f"it cannot be loaded: {first_line(error)}"
    result.write_text(wrong)


if __name__ == "__main__":
    _main(Path(sys.argv[1]), Path(sys.argv[2]))
