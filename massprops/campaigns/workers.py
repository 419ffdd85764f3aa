"""The processes that do the runs on one machine: started when needed, watched, ended and restarted."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from massprops.core.messages import HANDLE, Listener, Silence
from massprops.core.processes import child_environment, python_module

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "BLIS_NUM_THREADS")
LOOK_S = 0.05
"""How often a run's memory is looked at."""
START_S = 600.0
"""Longest time for a process to start and import what it needs."""
TOGETHER_S = 0.25
"""After so long, chunks that came together are handed back, those not yet begun undone."""


class Closed(Exception):
    """The workers are being closed: the runs in flight are given up."""


@dataclass(frozen=True)
class Reply:
    """What came of some seeds: `rows`, or `failure` (raised, died, time, memory) with `said`."""

    rows: list[dict[str, Any]] | None = None
    failure: str = ""
    message: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    versions: dict[str, str] | None = None


class Differs(Exception):
    """The process has other versions of the code than the campaign; `theirs` are its."""

    def __init__(self, theirs: dict[str, str]) -> None:
        super().__init__("versions differ")
        self.theirs = theirs


class Process:
    """One child process that does runs, one request at a time."""

    def __init__(self, own_threads: bool) -> None:
        read, write = os.pipe()
        environment = child_environment(**{HANDLE: str(write)})
        if not own_threads:
            environment |= dict.fromkeys(ONE_THREAD, "1")
        out = None if os.environ.get("MASSPROPS_DEBUG") else subprocess.DEVNULL
        self.own_threads = own_threads
        self.versions: dict[str, str] = {}
        self.child = subprocess.Popen(
            python_module("massprops.campaigns.child"),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=out,
            pass_fds=(write,),
            env=environment,
            start_new_session=True,
        )
        os.close(write)
        self.pipe, self.listener = read, Listener(read)

    def ask(
        self,
        request: dict[str, Any],
        versions: dict[str, str],
        strict: bool,
        time_s: float | None,
        memory_mb: float | None,
    ) -> Reply:
        """Does one request. The time limit starts when the process has finished its imports.

        Raises:
            Differs: the process has other versions, and `strict`.
        """
        assert self.child.stdin is not None
        try:
            self.child.stdin.write(json.dumps(request).encode() + b"\n")
            self.child.stdin.flush()
        except OSError:
            return self._died()
        try:
            self.versions = self.listener.next(START_S)["ready"]
        except Silence as silence:
            ended = silence.why == "ended"
            return self._died() if ended else Reply(failure="time", message="its process did not start")
        if strict and self.versions != versions:
            raise Differs(self.versions)
        begun = time.monotonic()
        most = float("inf") if memory_mb is None else memory_mb

        def too_large() -> str:
            return "memory" if memory_of(self.child.pid) > most else ""

        try:
            answer = self.listener.next(time_s, None if memory_mb is None else too_large, LOOK_S)
        except Silence as silence:
            if silence.why == "ended":
                return self._died()
            self.end()
            limit = f"{time_s:g} s" if silence.why == "time" else f"{memory_mb:g} MB"
            message = f"over its {silence.why} limit of {limit}"
            return Reply(failure=silence.why, message=message, wall_s=time.monotonic() - begun)
        spent = {"wall_s": answer["wall_s"], "cpu_s": answer["cpu_s"], "versions": self.versions}
        if "raised" in answer:
            return Reply(failure="raised", message=answer["raised"], **spent)
        return Reply(answer["rows"], **spent)

    def _died(self) -> Reply:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.child.wait(1.0)
        code = self.child.returncode
        self.end()
        if code is not None and code < 0:
            with contextlib.suppress(ValueError):
                return Reply(failure="died", message=f"its process died ({signal.Signals(-code).name})")
        return Reply(failure="died", message=f"its process ended (exit code {code})")

    @property
    def alive(self) -> bool:
        return self.child.poll() is None

    def end(self) -> None:
        """Ends the process and what it started."""
        if self.child.poll() is None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.child.pid, signal.SIGKILL)
        self.child.wait()
        if self.child.stdin is not None:
            with contextlib.suppress(OSError):
                self.child.stdin.close()
        if self.pipe >= 0:
            os.close(self.pipe)
            self.pipe = -1


def memory_of(pid: int) -> float:
    """Resident memory of a process and all below it [MB] (Linux; 0 elsewhere)."""
    total, waiting = 0.0, [pid]
    while waiting:
        one = waiting.pop()
        with contextlib.suppress(OSError, ValueError, IndexError):
            below = Path(f"/proc/{one}")
            total += int((below / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
            waiting += [int(word) for word in (below / "task" / str(one) / "children").read_text().split()]
    return total


class Workers:
    """Child processes of this process, one per thread that asks; safe to use from several threads."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.idle: list[Process] = []
        self.busy: set[Process] = set()
        self.closed = False

    def do_in_turn(self, tasks: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Replies of the first, and of as many more chunks as begin within `TOGETHER_S`."""
        end, replies = time.monotonic() + TOGETHER_S, [self.do(tasks[0])]
        for task in tasks[1:]:
            if time.monotonic() > end:
                break
            replies.append(self.do(task))
        return replies

    def do(self, task: dict[str, Any]) -> dict[str, Any]:
        """A chunk of runs.

        All seeds are done together. If that fails, every seed is repeated alone to find the one at fault. A seed whose process
        died is repeated once.

        Args:
            task: kind, parameters, draw, seeds, folder, versions, strict, time_s, memory_mb, own_threads.

        Returns:
            `rows`: per seed `seed`, `data`, `error`, `wall_s`, `cpu_s`, `versions` (None: the campaign's); `worker`;
            or `differs`: the versions here, when `strict` and they are not the campaign's.
        """
        seeds = task["seeds"]
        try:
            reply = self._ask(task, seeds)
            if reply.rows is not None:
                rows = [_row(seed, reply, k, len(seeds)) for k, seed in enumerate(seeds)]
            elif len(seeds) == 1 and reply.failure != "died":
                rows = [_row(seeds[0], reply)]
            else:
                rows = [self._alone(task, seed, again=len(seeds) > 1) for seed in seeds]
        except Differs as error:
            return {"differs": error.theirs, "worker": whoami()}
        for row in rows:
            if row["versions"] == task["versions"]:
                row["versions"] = None
        return {"rows": rows, "worker": whoami()}

    def _alone(self, task: dict[str, Any], seed: int, again: bool) -> dict[str, Any]:
        reply = self._ask(task, [seed])
        if reply.failure == "died" and again:
            reply = self._ask(task, [seed])
        return _row(seed, reply)

    def _ask(self, task: dict[str, Any], seeds: list[int]) -> Reply:
        process = self._take(bool(task["own_threads"]))
        request = {key: task[key] for key in ("kind", "parameters", "draw", "folder")} | {"seeds": list(seeds)}
        time_s = None if task["time_s"] is None else task["time_s"] * len(seeds)
        try:
            reply = process.ask(request, task["versions"], task["strict"], time_s, task["memory_mb"])
        except BaseException:
            process.end()
            self._give(process)
            raise
        if reply.failure in ("time", "memory", "died"):
            process.end()
        self._give(process)
        if self.closed:
            raise Closed
        return reply

    def _take(self, own_threads: bool) -> Process:
        with self.lock:
            if self.closed:
                raise Closed
            for process in [p for p in self.idle if not p.alive]:
                self.idle.remove(process)
                process.end()
            fitting = [p for p in self.idle if p.own_threads == own_threads]
            process = fitting[0] if fitting else Process(own_threads)
            if fitting:
                self.idle.remove(process)
            self.busy.add(process)
        return process

    def _give(self, process: Process) -> None:
        with self.lock:
            self.busy.discard(process)
            if process.pipe >= 0 and not self.closed:
                self.idle.append(process)
            else:
                process.end()

    def close(self) -> None:
        """Ends every process; runs in flight are given up."""
        with self.lock:
            self.closed = True
            for process in self.idle:
                process.end()
            for process in self.busy:  # its thread sees the end of the pipe and cleans up
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.child.pid, signal.SIGKILL)
            self.idle.clear()


def _row(seed: int, reply: Reply, k: int = 0, count: int = 1) -> dict[str, Any]:
    data = dict(reply.rows[k]) if reply.rows is not None else {}
    error = data.pop("error", None) if reply.rows is not None else reply.message
    return {
        "seed": seed,
        "data": data,
        "error": None if error in (None, "") else str(error),
        "wall_s": reply.wall_s / count,
        "cpu_s": reply.cpu_s / count,
        "versions": reply.versions,
    }


def whoami() -> str:
    """Host and process."""
    return f"{socket.gethostname()}:{os.getpid()}"
