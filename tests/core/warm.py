"""Commands that are forked from a process which has done such a command before: each costs its own work, not its start.

`shim.Faulty` starts an interpreter for every command, which takes longer than most commands that it makes fail. The stages
of a reconstruction are forked, too.
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
from types import SimpleNamespace
from typing import Any

from shim import Faulty

KNOWN, REAL = "WARM_KNOWN", "WARM_REAL"
"""Variables: a finished run, and the stages that are computed though it has them."""
ALONE = ("sfm",)
"""Stages in an interpreter of their own: pycolmap and numba do not go together in one process."""


class Warm(Faulty):
    """As `Faulty`; use it as a context.

    Args:
        place: a scratch folder.
        prepare: a command that is done once, in the process from which all others are forked.
        remember: functions, `module:name`, whose first answer is given again at each later call. They compute without
            a change of the disk; what becomes of the answer is what is looked at.

    Attributes:
        known: a finished run. A stage of the same key that reads the same bytes as there takes its answer and its files
            from there; None computes all. real: the stages that are computed all the same.
    """

    def __init__(self, place: Path, prepare: list[str], remember: tuple[str, ...] = ()) -> None:
        super().__init__(place)
        self.said = place / "said"
        self.known: Path | None = None
        self.real: tuple[str, ...] = ()
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
        if self.known:
            environment |= {KNOWN: str(self.known), REAL: " ".join(self.real)}
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


class _Stage:
    """In place of `subprocess.Popen`: the process of a stage, forked from the command's."""

    def __init__(self, command: list[str], stdout: Any, env: dict[str, str], **_: Any) -> None:
        self.returncode: int | None = None
        self.pid = os.fork()
        if not self.pid:
            _stage(command[-1], stdout.fileno(), env)

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def wait(self) -> None:
        os.waitpid(self.pid, 0)


def _started(command: list[str], **named: Any) -> Any:
    alone = Path(command[-1]).name.split(".")[0] in ALONE
    return (subprocess.Popen if alone else _Stage)(command, **named)


def _stage(request: str, output: int, environment: dict[str, str]) -> None:
    """Ends this process as the stage's."""
    code = 1
    try:
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.environ.clear()
        os.environ.update(environment)
        if not _taken_over(json.loads(Path(request).read_text())):
            from massprops.run import child

            sys.argv[1:] = [request]
            code = child.main()
            _remember_modules(os.environ.get("WARM_MODULES"))
        else:
            code = 0
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        os._exit(code)


def _taken_over(request: dict[str, Any]) -> bool:
    """Whether a stage took its files and its answer from the run that is known; that is no change of the disk."""
    import shutil

    from massprops.core.files import hash_tree
    from massprops.run.stages import ORDER, load_stage

    name = request["stage"]
    if not os.environ.get(KNOWN) or name in os.environ[REAL].split() or name in ORDER[-3:]:
        return False
    known, run = Path(os.environ[KNOWN]), Path(request["run"])
    entry = json.loads((known / "entries.json").read_text())[name]
    below = [f"work/{read}" for read in load_stage(name).READS]
    if entry["key"] != request["key"] or any(hash_tree(known / b) != hash_tree(run / b) for b in below):
        return False
    ctypes.CDLL(None).shim_end()
    shutil.copytree(known / "work" / name, request["out"], dirs_exist_ok=True)
    answer = {"facts": entry["facts"], "warnings": entry["warnings"]}
    os.write(int(os.environ["MASSPROPS_PIPE"]), json.dumps(answer).encode() + b"\n")
    return True


def _remember_modules(place: str | None) -> None:
    if place:
        with Path(place).open("a") as file:
            file.write("\n".join(sys.modules) + "\n")


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


def _fork_stages(modules: str) -> None:
    from massprops.run import runner

    runner.subprocess = SimpleNamespace(Popen=_started, DEVNULL=subprocess.DEVNULL, STDOUT=subprocess.STDOUT)
    os.environ["WARM_MODULES"] = modules


def _import_again(place: str | None) -> None:
    """What the stages imported."""
    for name in dict.fromkeys(Path(place).read_text().split()) if place else ():
        with contextlib.suppress(Exception):
            importlib.import_module(name)


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
    if given["prepare"][0] == "reconstruct":
        _fork_stages(given["said"] + ".modules")
    code = run(given["prepare"])
    _import_again(os.environ.pop("WARM_MODULES", None))
    print(json.dumps("ready" if code in (0, 3) else "failed"), file=answers, flush=True)
    for line in sys.stdin:
        pid = os.fork()
        if not pid:
            _command(json.loads(line), given["said"])
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), file=answers, flush=True)


if __name__ == "__main__":
    _serve(json.loads(sys.argv[1]))
