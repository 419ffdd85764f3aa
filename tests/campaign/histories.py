"""Seeded histories of faults of a Dask cluster on loopback: real processes, forked from one that has imported everything.

A history is one campaign of trivial runs. Faults strike when the store has come so far: a worker is killed, stopped for
a while, or cut off from the network; the scheduler or the client is killed; the first client's store is on a disk that is
full after some bytes. Whatever ended is started anew, and the same command is given until it succeeds.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import multiprocessing
import os
import resource
import shutil
import signal
import socket
import sqlite3
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from massprops.campaigns.configuration import plan_of
from massprops.campaigns.run import run_campaign
from massprops.campaigns.store import FILE
from massprops.errors import MasspropsError

FAULTS = ("worker killed", "worker stopped", "worker cut off", "scheduler killed", "client killed", "store full")
RUNS = 12
MOST_TRIES = 12
LONGEST_S = 300.0
"""A history that takes longer hangs."""

fork = multiprocessing.get_context("forkserver")


def _scheduler(file: str) -> None:
    from distributed import Scheduler

    async def main() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
            Path(file + ".tmp").write_text(scheduler.address)
            Path(file + ".tmp").rename(file)
            await scheduler.finished()

    _silent()
    asyncio.run(main())


def _worker(address: str) -> None:
    from distributed import Worker

    async def main() -> None:
        async with Worker(address, nthreads=1, dashboard=False, host="127.0.0.1") as worker:
            await worker.finished()

    _silent()
    signal.signal(signal.SIGUSR1, _cut_off)
    asyncio.run(main())
    os._exit(0)


def _client(content: dict[str, Any], out: str, address: str, limit: int | None, said: str) -> None:
    _silent()
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        run_campaign(plan_of(content), out, scheduler=address)
    except MasspropsError as error:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        Path(said).write_text(str(error))
        os._exit(error.exit_code)
    os._exit(0)


def _silent() -> None:
    """What Dask logs of its dying parts is not looked at."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for handle in (0, 1, 2):
        os.dup2(nowhere, handle)


def _cut_off(*_: object) -> None:
    """Ends every connection of this process."""
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(link.name))) as found:
            if found.family in (socket.AF_INET, socket.AF_INET6):
                found.shutdown(socket.SHUT_RDWR)


def _signal(process: Any, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(process.pid, number)


class Cluster:
    """A scheduler and two workers, replaced as they end."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.count = folder, 0
        self.scheduler: Any = None
        self.workers: list[Any] = []
        self.stopped: list[Any] = []
        self.address = ""

    def mend(self) -> None:
        """Starts what is missing."""
        if self.scheduler is None or not self.scheduler.is_alive():
            for worker in self.workers:  # they end with their scheduler, some later
                worker.kill()
            self.count += 1
            file = self.folder / f"scheduler{self.count}"
            self.scheduler = fork.Process(target=_scheduler, args=(str(file),))
            self.scheduler.start()
            end = time.monotonic() + 60
            while not file.exists():
                assert time.monotonic() < end, "the scheduler did not start"
                time.sleep(0.005)
            self.address = file.read_text()
        self.workers = [w for w in self.workers if w.is_alive()]
        while len(self.workers) - len(self.stopped) < 2:
            worker = fork.Process(target=_worker, args=(self.address,))
            worker.start()
            self.workers.append(worker)

    def strike(self, fault: str, rng: np.random.Generator, client: Any) -> None:
        """Lets a fault happen, to whatever still runs."""
        self.workers = [w for w in self.workers if w.is_alive()]
        if not self.workers:
            self.mend()
        worker = self.workers[int(rng.integers(len(self.workers)))]
        if fault == "worker killed":
            _signal(worker, signal.SIGKILL)
            worker.join()
        elif fault == "worker stopped":
            _signal(worker, signal.SIGSTOP)
            self.stopped.append(worker)
        elif fault == "worker cut off":
            _signal(worker, signal.SIGUSR1)
        elif fault == "scheduler killed":
            _signal(self.scheduler, signal.SIGKILL)
            self.scheduler.join()
        elif fault == "client killed":
            _signal(client, signal.SIGKILL)
            client.join()
        self.stopped = [w for w in self.stopped if w.is_alive()]

    def release(self) -> None:
        """Lets stopped workers go on."""
        for worker in self.stopped:
            _signal(worker, signal.SIGCONT)
        self.stopped = []

    def close(self) -> None:
        """Ends everything."""
        self.release()
        for process in (*self.workers, self.scheduler):
            if process is not None:
                process.kill()
                process.join()


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """A cluster for many histories."""
    fork.set_forkserver_preload(["distributed", "massprops.campaigns.run", "massprops.campaigns.cluster"])
    found = Cluster(folder)
    try:
        yield found
    finally:
        found.close()


def stored(out: Path) -> list[tuple[int, int, str, str | None]]:
    """The rows that are in a campaign's store."""
    try:
        base = sqlite3.connect(f"file:{out / FILE}?mode=ro", uri=True)
    except sqlite3.OperationalError:
        return []
    try:
        return base.execute("SELECT point, seed, data, error FROM runs ORDER BY point, seed").fetchall()
    except sqlite3.OperationalError:  # its tables are being made, or its last writer was killed
        return []
    finally:
        base.close()


def content_of(number: int) -> dict[str, Any]:
    """One of three small campaigns."""
    return {"kind": "drill", "runs": RUNS, "chunk": number % 3 + 1, "fails": 0.2, "grid": {"sigma": [1.0, 2.0]}}


def history(number: int, made: Cluster, folder: Path, wholes: dict[str, Any]) -> Counter[str]:
    """One history; what struck.

    Raises:
        AssertionError: it did not end in the table that the same campaign has on this machine without any fault.
    """
    rng = np.random.default_rng([16, number])
    content, out, said = content_of(number), folder / "out", folder / "said"
    faults = rng.choice(FAULTS, int(rng.integers(1, 4))).tolist()
    due = sorted((int(rng.integers(0, 2 * RUNS)), float(rng.uniform(0, 0.05)), f) for f in faults if f != "store full")
    limit = int(rng.integers(10, 120)) * 1024 if "store full" in faults else None
    struck: Counter[str] = Counter()
    end = time.monotonic() + LONGEST_S
    for _ in range(MOST_TRIES):
        made.mend()
        client = fork.Process(target=_client, args=(content, str(out), made.address, limit, str(said)))
        client.start()
        while client.is_alive():
            assert time.monotonic() < end, f"history {number} hangs: {faults}"
            if due and len(stored(out)) >= due[0][0]:
                _, wait, fault = due.pop(0)
                time.sleep(wait)
                if client.is_alive():
                    made.release()
                    made.strike(fault, rng, client)
                    struck[fault] += 1
                    if fault != "scheduler killed":
                        made.mend()
            elif made.stopped:
                time.sleep(0.05)
                made.release()
            client.join(0.01)
        client.join()
        made.release()
        if client.exitcode == 0:
            break
        if limit is not None and client.exitcode in (2, 3):
            struck["store full"] += 1
        limit = None
        assert client.exitcode in (2, 3, -signal.SIGKILL), f"history {number}: exit {client.exitcode}"
    assert client.exitcode == 0, f"history {number}, {faults}: {said.read_text() if said.exists() else ''}"
    key = json.dumps(content)
    if key not in wholes:
        run_campaign(plan_of(content), folder / "whole", workers=1)
        wholes[key] = shown(folder / "whole")
        shutil.rmtree(folder / "whole")
    assert shown(out) == wholes[key], f"history {number}, {faults}"
    shutil.rmtree(out)
    return struck


def shown(out: Path) -> dict[str, Any]:
    """What a campaign came to."""
    rows = stored(out)
    assert len(rows) == 2 * RUNS, f"{len(rows)} of {2 * RUNS} runs"
    return {"rows": rows, **{name: (out / name).read_bytes() for name in ("table.json", "runs.csv")}}
