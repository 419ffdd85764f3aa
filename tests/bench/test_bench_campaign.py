"""What campaigns cost: the 100-step stereo IEKF a thousand times, runs a second against workers, scheduling per run."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from massprops.campaigns.configuration import plan_of
from massprops.campaigns.kinds import load_kind
from massprops.campaigns.reproduce import reproduce_plan
from massprops.campaigns.run import run_campaign
from massprops.campaigns.store import Store
from massprops.campaigns.table import points_of

pytestmark = pytest.mark.bench


@contextlib.contextmanager
def dask(folder: Path, workers: int) -> Iterator[str]:
    """A scheduler and workers of one thread each, on loopback; gives the address."""
    from distributed import Client

    folder.mkdir()
    file = folder / "scheduler.json"
    base = [sys.executable, "-m", "dask"]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options = ["--scheduler-file", str(file), "--no-dashboard", "--host", "127.0.0.1"]
    processes = [subprocess.Popen([*base, "scheduler", *options, "--port", "0", "--no-show"], **quiet)]
    try:
        processes += [subprocess.Popen([*base, "worker", *options, "--nthreads", "1"], **quiet) for _ in range(workers)]
        end = time.monotonic() + 60
        while not (file.exists() and file.read_text().strip().endswith("}")):
            assert time.monotonic() < end
            time.sleep(0.05)
        address = str(json.loads(file.read_text())["address"])
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
        yield address
    finally:
        for process in processes[::-1]:
            process.terminate()
        for process in processes:
            process.wait(30)


def measured(plan: Any, out: Path, **where: Any) -> tuple[float, float, float]:
    """Wall seconds with everything, wall seconds of the runs in their processes, CPU seconds of the runs."""
    begun = time.monotonic()
    run_campaign(plan, out, **where)
    wall = time.monotonic() - begun
    with Store(out, plan.document(), plan.digest) as store:
        rows = [row for point in points_of(plan, store) for row in point.rows]
    return wall, sum(row.wall_s for row in rows), sum(row.cpu_s for row in rows)


def test_a_thousand_runs_of_the_stereo_iekf(tmp_path: Path) -> None:
    """pesce2017 C, 1000 runs: the same table on one and two workers and on a cluster, in under 60 s of CPU."""
    plan = reproduce_plan("pesce2017", "C", runs=1000)
    load_kind("paper").runs({"paper": "pesce2017", "case": "C"}, [0], None)  # compiled once, kept on disk
    print(f"\npesce2017 C, 1000 runs of 100 steps, chunks of {plan.chunk}")
    cpu = []
    for workers in (1, 2):
        wall, _, spent = measured(plan, tmp_path / str(workers), workers=workers)
        cpu.append(spent)
        print(f"  {workers} workers here: {wall:.1f} s, {1000 / wall:.0f} runs/s, CPU {spent:.1f} s")
    with dask(tmp_path / "dask", 2) as address:
        wall, _, spent = measured(plan, tmp_path / "cluster", scheduler=address)
    print(f"  2 Dask workers: {wall:.1f} s, {1000 / wall:.0f} runs/s, CPU {spent:.1f} s")
    tables = {(tmp_path / name / "table.json").read_bytes() for name in ("1", "2", "cluster")}
    assert len(tables) == 1
    assert min(cpu) < 60, cpu


def test_scheduling_per_run(tmp_path: Path) -> None:
    """Runs that cost next to nothing: what is left is starting, sending, storing and counting."""
    for chunk in (1, 10):
        plan = plan_of({"kind": "drill", "draws": 1, "runs": 2000, "chunk": chunk})
        for name in ("here", "dask"):
            with contextlib.ExitStack() as stack:
                out = tmp_path / f"{name}{chunk}"
                where: dict[str, Any] = {"workers": 1}
                if name == "dask":
                    where = {"scheduler": stack.enter_context(dask(tmp_path / f"d{chunk}", 1))}
                wall, inside, _ = measured(plan, out, **where)
            each = 1e3 * (wall - inside) / 2000
            print(f"\n  scheduling, chunks of {chunk}, one worker, {name}: {each:.2f} ms a run")
            assert each < 5.0
