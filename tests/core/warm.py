"""Commands that are forked from a process which has done such a command before: each costs its own work, not its start.

`shim.Faulty` starts an interpreter for every command, which takes longer than most commands that it makes fail.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from shim import Faulty


class Warm(Faulty):
    """As `Faulty`; use it as a context.

    Args:
        place: a scratch folder.
        prepare: a command that is done once, in the process from which all others are forked.
        remember: functions, `module:name`, whose first answer is given again at each later call. They compute without
            a change of the disk; what becomes of the answer is what is looked at.
    """

    def __init__(self, place: Path, prepare: list[str], remember: tuple[str, ...] = ()) -> None:
        super().__init__(place)
        self.said = place / "said"
        environment = {k: v for k, v in os.environ.items() if not k.startswith("SHIM_")}
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self.server = subprocess.Popen(
            [sys.executable, __file__, json.dumps({"prepare": prepare, "remember": remember, "said": str(self.said)})],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**environment, **threads, "LD_PRELOAD": str(self.library)},
        )
        assert self._line() == "ready", self.said.read_text()

    def __enter__(self) -> Warm:
        return self

    def __exit__(self, *_: object) -> None:
        self.server.kill()
        self.server.communicate()

    def _line(self) -> Any:
        assert self.server.stdout is not None
        return json.loads(self.server.stdout.readline() or '"ended"')

    def _run(self, arguments: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
        assert self.server.stdin is not None
        self.said.write_bytes(b"")
        self.server.stdin.write(json.dumps({"arguments": arguments, "environment": environment}) + "\n")
        self.server.stdin.flush()
        code = self._line()
        assert isinstance(code, int), self.said.read_text()
        return subprocess.CompletedProcess(arguments, code, "", self.said.read_text(errors="replace"))


def _remember(name: str) -> None:
    module, attribute = name.split(":")
    place = importlib.import_module(module)
    function, answers = getattr(place, attribute), []

    @functools.wraps(function)
    def again(*given: Any, **named: Any) -> Any:
        if not answers:
            answers.append(function(*given, **named))
        return answers[0]

    setattr(place, attribute, again)


def _streams(said: str) -> None:
    """The standard streams of a command, its words in a file."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    words = os.open(said, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    for handle, target in ((0, nowhere), (1, nowhere), (2, words)):
        os.dup2(target, handle)
    os.closerange(3, 64)


def _command(request: dict[str, Any], said: str) -> None:
    """Ends this process with the command's exit code."""
    code = 1
    try:
        os.setsid()
        _streams(said)
        os.environ.update(request["environment"])
        ctypes.CDLL(None).shim_begin()
        from massprops_cli.main import run

        code = run(request["arguments"])
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        os._exit(code)


def _serve(given: dict[str, Any]) -> None:
    from massprops_cli.main import run

    answers = os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_RDWR)
    with contextlib.suppress(OSError):
        Path(given["said"]).write_bytes(b"")
    words = os.open(given["said"], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    os.dup2(nowhere, 1)
    os.dup2(words, 2)
    for name in given["remember"]:
        _remember(name)
    code = run(given["prepare"])
    print(json.dumps("ready" if code in (0, 3) else "failed"), file=answers, flush=True)
    for line in sys.stdin:
        pid = os.fork()
        if not pid:
            _command(json.loads(line), given["said"])
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), file=answers, flush=True)


if __name__ == "__main__":
    _serve(json.loads(sys.argv[1]))
