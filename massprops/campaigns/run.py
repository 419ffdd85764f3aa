"""A campaign from plan to report."""

from __future__ import annotations

import contextlib
import csv
import io
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from massprops.campaigns.cluster import Cluster
from massprops.campaigns.configuration import Chunk, Plan, check_size, extends
from massprops.campaigns.engine import Backend, Watch, missing, rows_of, run_plan, task_of
from massprops.campaigns.kinds import load_kind
from massprops.campaigns.local import Local
from massprops.campaigns.report import write_report
from massprops.campaigns.store import FILE, Row, Store
from massprops.campaigns.table import Point, document, points_of
from massprops.core.files import plain, write_json, write_whole
from massprops.core.outputs import Outputs, claim
from massprops.core.processes import processors
from massprops.errors import InputError, NotPossible

OWNER = "campaign"
STORE = tuple(FILE + end for end in ("", "-wal", "-shm", "-journal"))
NAMES = ("campaign.yaml", "table.json", "runs.csv", "report.html", *STORE, "runs/")
MOST_WORKERS = 1024


@dataclass(frozen=True)
class Outcome:
    """A campaign's folder, its document (`table.json`), the versions that its rows were made with, and the rows."""

    folder: Path
    document: dict[str, Any]
    versions: list[dict[str, str]]
    points: list[Point]


def backend_of(plan: Plan, scheduler: str | None, workers: int | None) -> Backend:
    """Where the runs are done.

    Raises:
        InputError: both ways are asked for, a number out of range, or see `Cluster`.
    """
    if scheduler is not None:
        if workers is not None:
            raise InputError("--workers is for this machine, --scheduler for a cluster: give one of them")
        return Cluster(scheduler)
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise InputError(f"--workers {workers}: give a number from 1 to {MOST_WORKERS}")
    return Local(workers or (1 if load_kind(plan.kind).OWN_THREADS else processors()))


def run_campaign(
    plan: Plan,
    out: str | Path,
    scheduler: str | None = None,
    workers: int | None = None,
    yes: bool = False,
    watch: Watch | None = None,
    force: bool = False,
) -> Outcome:
    """Does what is missing of a campaign, then writes its table, rows and report.

    Args:
        plan: what to run.
        out: the campaign's folder; one that was begun with the same configuration, or with fewer runs, is continued.
        scheduler: address of a Dask scheduler; None runs on this machine.
        workers: processes on this machine; None takes one per core.
        yes: consent to more than a million runs.
        watch: told of progress.
        force: files in the folder that no campaign wrote may be replaced, and a store that an older version left is
            taken over.

    Raises:
        InputError: the folder belongs to another campaign or holds somebody's files, or see `backend_of` and `check_size`.
        NotPossible: the cluster or the disk failed on the way; finished runs are kept.
    """
    check_size(plan, yes)
    folder = Path(out).resolve()
    given = [Path(plan.where)]
    with claim(folder, OWNER, NAMES, given, force) as outputs, contextlib.ExitStack() as stack:
        _own(outputs)
        store = stack.enter_context(Store(folder, plan.document(), plan.digest, partial(extends, plan)))
        if next(missing(plan, store), None) is not None:
            backend = backend_of(plan, scheduler, workers)
            try:
                run_plan(plan, store, backend, folder, watch)
            finally:
                backend.close()
        points = points_of(plan, store)
        result = plain(document(plan, points))
        try:
            new = outputs.staging()
            write_whole(new / "campaign.yaml", yaml.safe_dump(plan.document(), sort_keys=False))
            write_json(new / "table.json", result)
            write_whole(new / "runs.csv", rows_csv(points))
            write_report(new, plan, points, result, store)
            outputs.publish(OWNER, plan.digest, given, force, keep_old=False)
        except OSError as error:
            raise NotPossible(
                f"{folder}: {error.strerror}: free some space, then give the same command again; finished runs are kept"
            ) from None
        versions = [v for _, _, v, count in store.sessions() if count]
    return Outcome(folder, result, [v for k, v in enumerate(versions) if v not in versions[:k]], points)


def _own(outputs: Outputs) -> None:
    """Records the store's files, and the folder for the files of runs, as the campaign's.

    Raises:
        InputError: the record cannot be written.
    """
    try:
        outputs.list_live(OWNER, *STORE)
        outputs.take_folder("runs", OWNER)
    except OSError as error:
        raise InputError(
            f"{outputs.folder}: cannot be written ({error.strerror}): choose another place with -o"
        ) from None


def run_alone(plan: Plan, seed: int, out: str | Path | None, scheduler: str | None, workers: int | None) -> list[Point]:
    """Repeats the runs of one seed at every point. The store is not changed.

    Args:
        out: where the runs may leave files, None for a folder that goes away.

    Raises:
        InputError: no point has that seed, or see `backend_of`.
    """
    chosen = [point for point in plan.laid_out() if seed in plan.seeds(point[2])]
    if not chosen:
        seeds = plan.seeds(next(plan.laid_out())[2])
        raise InputError(f"--only {seed}: {plan.where} has the seeds {seeds[0]} to {seeds[-1]}")
    backend = backend_of(plan, scheduler, workers)
    rows: dict[int, list[Row]] = {}
    with tempfile.TemporaryDirectory(prefix="massprops-") as spare:
        folder = Path(out).resolve() / f"only-{seed}" if out is not None else Path(spare)
        chunks = {number: Chunk(number, parameters, (seed,)) for number, _, parameters in chosen}
        try:
            for number, chunk in chunks.items():
                backend.submit(number, [task_of(plan, chunk, folder, backend.strict)])
            while len(rows) < len(chunks):
                for number, replies in backend.wait(1.0):
                    rows[number] = rows_of(chunks[number], replies[0])
        finally:
            backend.close()
    return [Point(number, cell, parameters, rows[number]) for number, cell, parameters in chosen]


def rows_csv(points: list[Point]) -> str:
    """Every run as a line of CSV: point, what the grid set, seed, its columns, error."""
    grid = list(dict.fromkeys(name for p in points for name in p.cell))
    data = list(dict.fromkeys(name for p in points for r in p.rows for name in r.data))
    data = [name for name in data if name not in (*grid, "seed")]
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["point", *grid, "seed", *data, "error"])
    for point in points:
        for row in point.rows:
            cells = [point.cell.get(name) for name in grid] + [row.seed] + [row.data.get(name) for name in data]
            writer.writerow([point.number, *("" if c is None else c for c in cells), row.error or ""])
    return file.getvalue()
