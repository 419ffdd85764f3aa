"""Campaigns on a real Dask cluster on loopback: two worker processes, one of which is killed."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from asyncio import CancelledError
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

import massprops
from massprops.campaigns import cluster as backend
from massprops.campaigns.configuration import plan_of
from massprops.campaigns.run import run_campaign
from massprops.campaigns.store import FILE
from massprops.errors import NotPossible
from massprops_cli.main import run

pytest.importorskip("distributed")


class Cluster:
    """A scheduler and its workers, each a process; `address` once it answers."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.file = folder, folder / "scheduler.json"
        self.workers: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
        until(lambda: self.file.exists() and self.file.read_text().strip().endswith("}"), "the scheduler")
        self.address = str(json.loads(self.file.read_text())["address"])

    def _start(self, what: str, *options: str, **environment: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", what, "--scheduler-file", str(self.file), *options]
        log = (self.folder / f"{what}{len(self.workers)}.log").open("wb")
        return subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, **environment}, cwd=self.folder)

    def add_worker(self, **environment: str) -> None:
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        self.workers.append(self._start("worker", *options, **environment))

    def add_deaf(self, when: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", DEAF, self.address, when]
        self.workers.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL))
        assert self.workers[-1].stdout is not None and self.workers[-1].stdout.readline() == b"ready\n"
        return self.workers[-1]

    def wait_for(self, count: int) -> None:
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)

    def wait_until_all_work(self) -> None:
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            until(lambda: all(client.processing().values()), "work for every worker")

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


DEAF = """
import asyncio, sys
from distributed import Worker

async def main():
    async with Worker(sys.argv[1], nthreads=1, dashboard=False, host="127.0.0.1") as worker:
        def deafen():
            worker.stop()
            for line in list(worker._comms):  # the scheduler keeps lines open, to be used again
                line.abort()
            print("deaf", flush=True)

        if sys.argv[2] == "at once":
            worker.stop()
        else:
            asyncio.get_running_loop().add_signal_handler(10, deafen)
        print("ready", flush=True)
        await worker.finished()

asyncio.run(main())
"""
"""A worker that goes on talking to its scheduler, and cannot be reached: as behind a firewall."""


def until(true: Callable[[], object], what: str) -> None:
    """Waits for an event; a minute without it is a failure."""
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.01)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    (tmp_path / "dask").mkdir()
    found = Cluster(tmp_path / "dask")
    yield found
    found.close()


def stored(out: Path) -> list[tuple[int, int, str]]:
    if not (out / FILE).exists():
        return []
    base = sqlite3.connect(out / FILE)
    try:
        return base.execute("SELECT point, seed, worker FROM runs").fetchall()
    except sqlite3.OperationalError:  # its tables are being made
        return []
    finally:
        base.close()


def test_the_same_table_from_a_cluster_of_which_half_dies(tmp_path: Path, cluster: Cluster) -> None:
    gate, out = tmp_path / "gate", tmp_path / "cluster"
    content = {"kind": "drill", "runs": 30, "chunk": 5, "fails": 0.1, "grid": {"gate": [None, str(gate)]}}
    plan = plan_of(content)
    cluster.add_worker()
    cluster.add_worker()
    cluster.wait_for(2)
    failed: list[BaseException] = []

    def campaign() -> None:
        try:
            run_campaign(plan, out, scheduler=cluster.address)
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=campaign)
    thread.start()
    until(lambda: failed or len(stored(out)) == 30, "the runs before the gate")
    # both workers now wait at the gate, each with a chunk in its hands
    cluster.workers[0].send_signal(signal.SIGKILL)
    cluster.workers[0].wait()
    gate.touch()
    thread.join(120)
    assert not failed and not thread.is_alive(), failed
    rows = stored(out)
    assert len(rows) == 60
    assert len({worker for _, _, worker in rows}) == 2, "both workers made runs"
    assert {w for p, _, w in rows if p == 1} == {w for _, _, w in rows if w.endswith(f":{cluster.workers[1].pid}")}
    run_campaign(plan, tmp_path / "local", workers=2)
    for name in ("table.json", "runs.csv"):
        assert (out / name).read_bytes() == (tmp_path / "local" / name).read_bytes()


@pytest.mark.bench
def test_single_runs_through_a_scheduler_cost_less_than_5_ms(tmp_path: Path, cluster: Cluster) -> None:
    """Chunks of one run that does next to nothing; processor time of client, scheduler, worker and the run's process."""
    cluster.add_worker()
    cluster.wait_for(1)
    warm, plan = (plan_of({"kind": "drill", "draws": 1, "runs": n, "chunk": 1}) for n in (10, 1000))
    run_campaign(warm, tmp_path / "warm", scheduler=cluster.address)

    def spent() -> float:
        return time.process_time() + sum(_cpu(p.pid) for p in (cluster.scheduler, *cluster.workers))

    before = spent()
    run_campaign(plan, tmp_path / "out", scheduler=cluster.address)
    assert (spent() - before) / 1000 < 5e-3


def _cpu(pid: int) -> float:
    """Processor time of a process and of those that it runs [s]."""
    words = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    below = [int(k) for t in Path(f"/proc/{pid}/task").iterdir() for k in (t / "children").read_text().split()]
    return sum(map(int, words[11:13])) / os.sysconf("SC_CLK_TCK") + sum(_cpu(k) for k in below)


def test_workers_with_another_version_are_refused(
    tmp_path: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    source = Path(massprops.__file__).parent
    shutil.copytree(source, tmp_path / "old/massprops", ignore=shutil.ignore_patterns("__pycache__", "*.stl"))
    first = tmp_path / "old/massprops/__init__.py"
    first.write_text(first.read_text().replace(f'"{massprops.__version__}"', '"0.0.7"'))
    cluster.add_worker(PYTHONPATH=str(tmp_path / "old"))
    cluster.wait_for(1)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 3}))
    out = tmp_path / "out"
    assert run(["campaign", str(tmp_path / "study.yaml"), "-o", str(out), "--scheduler", cluster.address]) == 2
    said = capsys.readouterr().err
    assert f"massprops {massprops.__version__} here, 0.0.7 there" in said, said
    assert len(said.strip().splitlines()) == 1 and stored(out) == []


def test_workers_without_massprops_and_no_workers_at_all(
    tmp_path: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 3}))
    command = ["campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--scheduler", cluster.address]
    monkeypatch.setattr("massprops.campaigns.cluster.ANSWER_S", 1.0)
    assert run(command) == 2
    assert "no workers" in capsys.readouterr().err
    (tmp_path / "none/massprops").mkdir(parents=True)
    (tmp_path / "none/massprops/__init__.py").write_text("raise ImportError('not here')\n")
    cluster.add_worker(PYTHONPATH=str(tmp_path / "none"))
    cluster.wait_for(1)
    assert run(command) == 2
    said = capsys.readouterr().err
    assert "massprops cannot be used there" in said and len(said.strip().splitlines()) == 1


def test_a_scheduler_that_does_not_answer(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("massprops.campaigns.cluster.ANSWER_S", 1.0)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 3}))
    command = ["campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--scheduler"]

    def says(address: str, expected: str) -> None:
        assert run([*command, address]) == 2
        said = capfd.readouterr().err
        assert expected in said and len(said.strip().splitlines()) == 1, said

    says("nonsense", "not a Dask scheduler")
    with socket.socket() as deaf:  # accepts, and never says a word
        deaf.bind(("127.0.0.1", 0))
        deaf.listen(5)
        says(f"tcp://127.0.0.1:{deaf.getsockname()[1]}", "no answer")


def test_a_port_where_nobody_listens(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("massprops.campaigns.cluster.ANSWER_S", 1.0)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 3}))
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{closed.getsockname()[1]}"
        assert run(["campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--scheduler", address]) == 2
    said = capfd.readouterr().err
    assert "no answer" in said and len(said.strip().splitlines()) == 1, said


@pytest.mark.parametrize("when", ["connected to", "asked for its workers", "asked to forget"])
def test_a_scheduler_that_ends_or_is_too_slow_while_it_is(monkeypatch: pytest.MonkeyPatch, when: str) -> None:
    """As on a machine with forty processes for two processors: it answers the first knock, and no more."""

    class Client:
        id, status = "Client-worker-1", "running"

        def __init__(self, address: str, **_: object) -> None:
            if when == "connected to":
                raise OSError("Timed out trying to connect")

        def wait_for_workers(self, *_: object, **__: object) -> None:
            raise TimeoutError

        def nthreads(self) -> dict[str, int]:
            raise CancelledError if when == "asked for its workers" else RuntimeError("IOLoop is closed")

        def close(self, **_: object) -> None:
            raise TimeoutError

    monkeypatch.setattr("distributed.Client", Client)
    monkeypatch.setattr(backend, "_check_scheduler", lambda address: None)
    with pytest.raises(
        NotPossible, match=r"went away \(.+\): start it and give the same command again; finished runs are kept"
    ):
        backend.Cluster("tcp://127.0.0.1:1")


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither Dask nor massprops knocks for long."""
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "0.5s")
    monkeypatch.setattr("massprops.campaigns.cluster.REACH_S", 2.0)


def test_a_worker_that_cannot_be_reached_gets_no_work(
    tmp_path: Path, impatient: None, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 6, "chunk": 1}))
    command = ["campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--scheduler", cluster.address]
    cluster.add_deaf("at once")
    assert run(command) == 2
    said = capsys.readouterr().err
    assert "it can reach none of its 1 workers" in said and len(said.strip().splitlines()) == 1, said
    cluster.add_worker()
    cluster.wait_for(2)
    assert run(command) == 0
    assert {w.rsplit(":", 1)[1] for _, _, w in stored(tmp_path / "out")} == {str(cluster.workers[1].pid)}


def test_results_on_a_worker_that_can_no_longer_be_reached_are_made_elsewhere(
    tmp_path: Path, impatient: None, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    again: list[object] = []
    give = backend.Cluster._give_out_again
    monkeypatch.setattr(backend.Cluster, "_give_out_again", lambda self, key: (again.append(key), give(self, key)))
    gate, out = tmp_path / "gate", tmp_path / "cluster"
    plan = plan_of({"kind": "drill", "runs": 8, "chunk": 1, "grid": {"gate": [None, str(gate)]}})
    deaf = cluster.add_deaf("later")
    cluster.add_worker()
    cluster.wait_for(2)
    thread = threading.Thread(target=run_campaign, args=(plan, out), kwargs={"scheduler": cluster.address})
    thread.start()
    until(lambda: len(stored(out)) == 8, "the runs before the gate")
    cluster.wait_until_all_work()
    deaf.send_signal(signal.SIGUSR1)  # both workers wait at the gate, and their results will
    assert deaf.stdout is not None and deaf.stdout.readline() == b"deaf\n"
    gate.touch()
    thread.join(120)
    assert not thread.is_alive() and len(stored(out)) == 16 and again
    run_campaign(plan, tmp_path / "local", workers=1)
    for name in ("table.json", "runs.csv"):
        assert (out / name).read_bytes() == (tmp_path / "local" / name).read_bytes()
