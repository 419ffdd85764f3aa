"""Campaigns on this machine: the same table on any number of workers, and every way a run can fail."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from massprops.campaigns.configuration import plan_of
from massprops.campaigns.engine import Progress, rows_of, run_plan, task_of
from massprops.campaigns.kinds import load_kind
from massprops.campaigns.local import Local
from massprops.campaigns.run import run_alone, run_campaign
from massprops.campaigns.store import FILE, Row, Store
from massprops.campaigns.workers import Workers
from massprops.errors import InputError, NotPossible
from massprops_cli.main import run

SMALL: dict[str, Any] = {"kind": "drill", "runs": 23, "chunk": 5, "grid": {"sigma": [1, 2]}, "fails": 0.2}


HEARS = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
INTERRUPTIBLE = [sys.executable, "-c", f"{HEARS}; from massprops_cli.main import main; main()"]
"""The command, which hears an interrupt even where the tests run in the background, as a shell starts a job with `&`."""


def until(true: Callable[[], object], what: str) -> None:
    """Waits for an event; a minute without it is a failure."""
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.01)


def test_the_same_table_on_1_2_and_4_workers(tmp_path: Path) -> None:
    plan = plan_of(SMALL)
    for count in (1, 2, 4):
        run_campaign(plan, tmp_path / str(count), workers=count)
    for name in ("table.json", "runs.csv", "campaign.yaml"):
        assert len({(tmp_path / str(c) / name).read_bytes() for c in (1, 2, 4)}) == 1, name
    document = json.loads((tmp_path / "1/table.json").read_text())
    assert document["done"] == document["runs"] == 46
    assert document["failed"] == sum(document["failures"].values()) > 0


def test_runs_that_raise_are_rows_and_do_not_take_others_with_them(tmp_path: Path) -> None:
    bad = plan_of(SMALL)
    good = plan_of({**SMALL, "fails": 0.0})
    told: list[Progress] = []
    run_campaign(bad, tmp_path / "bad", workers=1, watch=told.append)
    run_campaign(good, tmp_path / "good", workers=1)
    with (
        Store(tmp_path / "bad", bad.document(), bad.digest) as one,
        Store(tmp_path / "good", good.document(), good.digest) as two,
    ):
        rows, whole = one.rows(0), two.rows(0)
    assert [r.seed for r in rows] == list(range(23))
    failed = [r for r in rows if r.error]
    assert 0 < len(failed) < 23 and all("ValueError" in str(r.error) and str(r.seed) in str(r.error) for r in failed)
    assert [r.data for r in rows if not r.error] == [w.data for w, r in zip(whole, rows, strict=True) if not r.error]
    assert told[-1].done == told[-1].total == 46 and told[-1].failed == 2 * len(failed)
    assert [p.done for p in told] == sorted(p.done for p in told)


def test_runs_over_their_limits_are_rows(tmp_path: Path) -> None:
    says = {"hangs": "time limit of 1 s", "grows": "memory limit of 300 MB", "dies": "SIGKILL"}
    limits: dict[str, dict[str, float]] = {"hangs": {"time_s": 1.0}, "grows": {"memory_mb": 300}, "dies": {}}
    bad = {seed for seed in (1, 2) if np.random.default_rng(seed).random() < 0.3}
    for what in limits:
        content = {"kind": "drill", "seed": 1, "runs": 2, "chunk": 2, what: 0.3, "limits": limits[what]}
        plan = plan_of(content)
        outcome = run_campaign(plan, tmp_path / what, workers=1)
        with Store(tmp_path / what, plan.document(), plan.digest) as store:
            rows = store.rows(0)
        assert {r.seed for r in rows if r.error} == bad, what
        assert all(says[what] in str(r.error) for r in rows if r.error), [r.error for r in rows]
        assert all("mean" in r.data for r in rows if not r.error)
        assert outcome.document["failed"] == len(bad) == 1


def test_a_run_whose_process_dies_is_done_again_once(tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    plan = plan_of({"kind": "drill", "runs": 1, "gate": str(gate)})
    chunk = next(plan.chunks())

    def killed(times: int) -> tuple[dict[str, Any], int]:
        gate.unlink(missing_ok=True)
        workers, replies, seen = Workers(), list[Any](), set[int]()
        thread = threading.Thread(target=lambda: replies.append(workers.do(task_of(plan, chunk, None))))
        thread.start()
        for _ in range(times):
            until(lambda: {p.child.pid for p in workers.busy} - seen, "a process")
            pid = ({p.child.pid for p in workers.busy} - seen).pop()
            seen.add(pid)
            os.kill(pid, signal.SIGKILL)
        gate.touch()
        thread.join(60)
        workers.close()
        return replies[0]["rows"][0], len(seen)

    good, _ = killed(0)
    again, _ = killed(1)
    given_up, _ = killed(2)
    assert again["error"] is None and again["data"] == good["data"] != {}
    assert "SIGKILL" in given_up["error"] and given_up["data"] == {}


def test_a_killed_campaign_continues_where_it_stood(tmp_path: Path) -> None:
    gate, out = tmp_path / "gate", tmp_path / "out"
    content = {"kind": "drill", "runs": 20, "chunk": 5, "grid": {"gate": [None, str(gate)]}}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    code = "from massprops_cli.main import main; main()"
    command = [sys.executable, "-c", code, "campaign", str(tmp_path / "study.yaml"), "-o", str(out), "--workers", "2"]
    client = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)

    def stored() -> list[tuple[int, int, int]]:
        if not (out / FILE).exists():
            return []
        base = sqlite3.connect(out / FILE)
        try:
            return base.execute("SELECT point, seed, session FROM runs").fetchall()
        except sqlite3.OperationalError:  # its tables are being made
            return []
        finally:
            base.close()

    until(lambda: len(stored()) == 20, "the runs before the gate")
    below = children(client.pid)
    os.kill(client.pid, signal.SIGKILL)
    client.communicate()
    until(lambda: not any(_running(pid) for pid in below), "the end of its processes")
    assert below and len(stored()) == 20
    gate.touch()
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    rows = stored()
    assert {(p, s) for p, s, session in rows if session == 1} == {(0, s) for s in range(20)}
    assert {(p, s) for p, s, session in rows if session == 2} == {(1, s) for s in range(20)}
    run_campaign(plan_of(content), tmp_path / "whole", workers=1)
    assert (out / "table.json").read_bytes() == (tmp_path / "whole/table.json").read_bytes()
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, timeout=120, check=False)
    assert json.loads(done.stdout) == json.loads((out / "table.json").read_text())
    assert len(stored()) == 40 and "runs/s" not in done.stderr, "a finished campaign does nothing again"


def children(pid: int) -> list[int]:
    """Processes that any thread of a process has started."""
    return [int(p) for t in Path(f"/proc/{pid}/task").iterdir() for p in (t / "children").read_text().split()]


def _running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_interrupted_gives_130_and_leaves_no_process(tmp_path: Path) -> None:
    content = {"kind": "drill", "runs": 2, "hangs": 1.0}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    command = [*INTERRUPTIBLE, "campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out")]
    client = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    until(lambda: children(client.pid), "a run")
    below = children(client.pid)
    client.send_signal(signal.SIGINT)
    said = client.communicate(timeout=60)[1]
    assert client.returncode == 130 and "to continue" in said and "Traceback" not in said
    assert not any(_running(pid) for pid in below)


def test_what_keeps_nothing_does_not_promise_to_continue() -> None:
    command = [*INTERRUPTIBLE, "reproduce", "hu2024", "--runs", "50", "--workers", "1"]
    client = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    until(lambda: children(client.pid), "a run")
    client.send_signal(signal.SIGINT)
    said = client.communicate(timeout=60)[1]
    assert (
        client.returncode == 130
        and "start from the beginning" in said
        and "-o FOLDER" in said
        and "again to continue" not in said
    ), said


def test_any_run_can_be_made_again_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = {**SMALL, "draw": {"draws": {"integer": [10, 500]}}, "seed": 1000}
    plan = plan_of(content)
    run_campaign(plan, tmp_path / "out", workers=1)
    alone = run_alone(plan, 1017, None, None, 1)
    with Store(tmp_path / "out", plan.document(), plan.digest) as store:
        for point in alone:
            (stored,) = [r for r in store.rows(point.number) if r.seed == 1017]
            assert (stored.data, stored.error) == (point.rows[0].data, point.rows[0].error)
            assert stored.data["draws"] in range(10, 501)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(content))
    assert run(["campaign", str(tmp_path / "study.yaml"), "--only", "1017", "--json", "--workers", "1"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [r["seed"] for r in rows] == [1017, 1017] and rows[0]["mean"] == alone[0].rows[0].data["mean"]
    assert run(["campaign", str(tmp_path / "study.yaml"), "--only", "17"]) == 2
    assert "1000 to 1022" in capsys.readouterr().err


def test_a_store_of_another_configuration_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "one.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 2}))
    (tmp_path / "two.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 2, "seed": 9}))
    assert run(["campaign", str(tmp_path / "one.yaml"), "-o", str(tmp_path / "out"), "-q"]) == 0
    before = (tmp_path / "out/table.json").read_bytes()
    capsys.readouterr()
    assert run(["campaign", str(tmp_path / "two.yaml"), "-o", str(tmp_path / "out"), "-q"]) == 2
    said = capsys.readouterr().err
    assert "another configuration" in said and len(said.strip().splitlines()) == 1
    assert (tmp_path / "out/table.json").read_bytes() == before
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / FILE).write_text("not a database " * 100)
    assert run(["campaign", str(tmp_path / "one.yaml"), "-o", str(tmp_path / "broken"), "-q"]) == 2
    assert "not written by massprops" in capsys.readouterr().err
    assert run(["campaign", str(tmp_path / "one.yaml"), "-o", str(tmp_path / "broken"), "-q", "--force"]) == 2
    assert "not a campaign's store" in capsys.readouterr().err


def test_the_store_is_append_only_and_keeps_the_first_row(tmp_path: Path) -> None:
    with Store(tmp_path, {"a": 1}, "x") as store:
        store.begin("here", {"massprops": "1"})
        store.add([Row(0, 5, {"v": 1.0 / 3.0}), Row(0, 3, {"v": 2.0}, "bad")])
        store.add([Row(0, 5, {"v": 9.0})])
        assert [(r.seed, r.data, r.error) for r in store.rows(0)] == [
            (3, {"v": 2.0}, "bad"),
            (5, {"v": 1.0 / 3.0}, None),
        ]
        for statement in (
            "DELETE FROM runs",
            "UPDATE runs SET data = ''",
            "DELETE FROM campaign",
            "UPDATE sessions SET place = ''",
        ):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                store.base.execute(statement)
        assert list(store.sessions())[0][1:] == ("here", {"massprops": "1"}, 2)
    with pytest.raises(InputError, match="another configuration"):
        Store(tmp_path, {"a": 1}, "y")


def test_a_process_with_other_versions_is_refused(tmp_path: Path) -> None:
    plan = plan_of({"kind": "drill", "runs": 2})
    chunk = next(plan.chunks())
    task = task_of(plan, chunk, None, strict=True)
    other = {**task["versions"], "numpy": "0.1"}
    workers = Workers()
    reply = workers.do({**task, "versions": other})
    loose = workers.do({**task, "versions": other, "strict": False})
    workers.close()
    assert reply["differs"]["numpy"] == task["versions"]["numpy"] and "rows" not in reply
    rows_of(chunk, {"rows": [], "worker": "w"})
    with pytest.raises(InputError, match=r"worker w: versions differ \(numpy .* here, 0.1 there\)"):
        rows_of(chunk, {"differs": other, "worker": "w"})
    # on one machine the code may be edited meanwhile: the rows are kept with the versions that made them
    with Store(tmp_path, {}, "x") as store:
        store.begin("here", other)
        store.add(rows_of(chunk, loose))
        assert [(v["numpy"], count) for _, _, v, count in store.sessions()] == [
            ("0.1", 0),
            (task["versions"]["numpy"], 2),
        ]


def test_a_store_that_is_full_or_damaged_is_told_wherever_it_shows(tmp_path: Path) -> None:
    """At the note of who makes the rows, as well as at a row."""
    plan = plan_of({"kind": "drill", "runs": 2})
    store = Store(tmp_path, plan.document(), plan.digest)
    pages = store.base.execute("PRAGMA page_count").fetchone()[0]
    store.base.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(NotPossible, match=r"full: free some space"), store:
        for _ in range(10_000):
            store.begin("here", {"x": "y" * 1000})
    with (
        pytest.raises(InputError, match=r"damaged \(malformed\)"),
        Store(tmp_path, plan.document(), plan.digest),
    ):
        raise sqlite3.DatabaseError("malformed")


class Odd:
    """A backend that does its tasks at once, never more than three of those that came together, and dies of one seed."""

    place, strict, ahead, fatal, passing, passed = "odd", False, 2, 7, 0, 0

    def __init__(self) -> None:
        self.came: list[tuple[Any, list[Any]]] = []
        self.sizes: list[int] = []

    def slots(self) -> int:
        return 1

    def submit(self, key: Any, tasks: list[dict[str, Any]]) -> None:
        self.sizes.append(len(tasks))
        points = {task["parameters"]["sigma"] for task in tasks}
        assert len(points) == 1, "runs of one point only travel together"
        passing = self.passing in tasks[0]["seeds"] and self.passed < 2  # workers die, but not of it
        self.passed += passing
        if passing or any(self.fatal in task["seeds"] for task in tasks):
            self.came.append((key, [type("KilledWorker", (Exception,), {})()]))
            return
        kind, rows = load_kind("drill"), []
        for task in tasks[:3]:
            made = kind.runs(task["parameters"], task["seeds"], None)
            rows.append(
                [
                    {"seed": s, "data": r, "error": None, "wall_s": 0.0, "cpu_s": 0.0, "versions": None}
                    for s, r in zip(task["seeds"], made, strict=True)
                ]
            )
        self.came.append((key, [{"rows": r, "worker": "w"} for r in rows]))

    def wait(self, seconds: float) -> list[tuple[Any, list[Any]]]:
        came, self.came = self.came, []
        return came

    def close(self) -> None: ...


def test_chunks_that_travel_together_come_back_undone_or_are_told_apart(tmp_path: Path) -> None:
    plan = plan_of({"kind": "drill", "runs": 200, "chunk": 2, "grid": {"sigma": [1, 2]}})
    odd = Odd()
    with Store(tmp_path, plan.document(), plan.digest) as store:
        run_plan(plan, store, odd, tmp_path)
        rows = [store.rows(0), store.rows(1)]
    run_campaign(plan, tmp_path / "whole", workers=1)
    with Store(tmp_path / "whole", plan.document(), plan.digest) as store:
        whole = [store.rows(0), store.rows(1)]
    assert max(odd.sizes) > 3
    for some, all_ in zip(rows, whole, strict=True):
        assert [r.seed for r in some] == list(range(200))
        assert {r.seed for r in some if r.error} == {6, 7}, "the chunk at fault and no other"
        assert [r.data for r in some if not r.error] == [w.data for w in all_ if w.seed not in (6, 7)]


def test_one_campaign_at_a_time_in_a_folder(tmp_path: Path) -> None:
    from massprops.core.outputs import locked

    with locked(tmp_path), pytest.raises(InputError, match="another massprops"):
        run_campaign(plan_of({"kind": "drill", "runs": 1}), tmp_path, workers=1)


@pytest.mark.parametrize(
    ("options", "says"),
    [(["--workers", "0"], "--workers 0"), (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "one of them")],
)
def test_wrong_options(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], says: str) -> None:
    (tmp_path / "one.yaml").write_text("kind: drill\nruns: 2\n")
    assert run(["campaign", str(tmp_path / "one.yaml"), "-o", str(tmp_path / "out"), *options]) == 2
    assert says in capsys.readouterr().err
    assert run(["campaign", str(tmp_path / "one.yaml")]) == 2
    assert "-o" in capsys.readouterr().err


@pytest.mark.bench
def test_scheduling_costs_less_than_5_ms_a_run(tmp_path: Path) -> None:
    """Chunks of one run that does next to nothing; processor time of the client, which a busy machine does not stretch."""
    plan = plan_of({"kind": "drill", "runs": 400, "draws": 1, "chunk": 1})
    with Store(tmp_path, plan.document(), plan.digest) as store:
        backend = Local(1)
        begun = time.process_time()
        run_plan(plan, store, backend, tmp_path)
        spent = time.process_time() - begun
        backend.close()
        inside = sum(r.wall_s for r in store.rows(0))
    assert spent / 400 < 5e-3 and inside / 400 < 5e-3, (spent, inside)


def test_a_campaign_without_one_good_run_says_so(tmp_path: Path, capsys) -> None:
    (tmp_path / "study.yaml").write_text("kind: drill\nruns: 3\nfails: 1.0\n")
    assert run(["campaign", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--workers", "1", "-q"]) == 3
    said = capsys.readouterr()
    assert "every run failed" in said.err and (tmp_path / "out" / "report.html").is_file()
