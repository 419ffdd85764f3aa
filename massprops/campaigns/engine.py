"""Gives a plan's chunks to a backend and stores the rows that come back.

A backend has `place`, `strict`, `ahead`, `slots()`, `submit(key, tasks)`, `wait(seconds) -> [(key, replies)]` and
`close()`; there are `Local` and `Cluster`. What a run is given and what its row holds are the same with both, and so are
the chunks. Short chunks travel several at a time: a message through a scheduler costs as much as a short run.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from massprops.campaigns.cluster import check_versions
from massprops.campaigns.configuration import Chunk, Plan
from massprops.campaigns.kinds import load_kind
from massprops.campaigns.store import Row, Store
from massprops.campaigns.versions import versions
from massprops.errors import NotPossible

LOOK_S = 0.5
"""Longest time between two looks at the number of slots, and between two words of progress."""
MOST_TOGETHER = 32
"""Chunks that are given out together at most."""
OFTEN = 3
"""Times that Dask gives a chunk up, each after four workers that had it died, until its runs are called the cause: in a
cluster that takes workers away, others die beside them."""


class Backend(Protocol):
    """Where runs are done."""

    place: str
    strict: bool  # refuses processes with other versions of the code
    ahead: int  # submissions per slot, the one at work included

    def slots(self) -> int: ...

    def submit(self, key: Any, tasks: list[dict[str, Any]]) -> None:
        """Gives out tasks that one worker does in turn (`Workers.do_in_turn`)."""

    def wait(self, seconds: float) -> list[tuple[Any, list[Any]]]:
        """What has come, after at most so long: replies of the first tasks, those left out undone; or one exception."""

    def close(self) -> None: ...


@dataclass(frozen=True)
class Progress:
    """How far a campaign is: runs done of total, failed among them; rate [runs/s], left [s] or None; slots."""

    done: int
    total: int
    failed: int
    rate: float
    left_s: float | None
    slots: int


Watch = Callable[[Progress], None]


def task_of(plan: Plan, chunk: Chunk, folder: Path | None, strict: bool = False) -> dict[str, Any]:
    """The task that a worker receives."""
    return {
        "kind": plan.kind,
        "parameters": chunk.parameters,
        "draw": plan.draw,
        "seeds": list(chunk.seeds),
        "folder": None if folder is None else str(folder / "runs" / f"{chunk.point:05d}"),
        "versions": versions(),
        "strict": strict,
        "time_s": plan.time_s,
        "memory_mb": plan.memory_mb,
        "own_threads": load_kind(plan.kind).OWN_THREADS,
    }


def missing(plan: Plan, store: Store) -> Iterator[Chunk]:
    """The runs that are not in the store, by chunks: a chunk is stored whole, or in part where the campaign was extended."""
    counts = store.counts()
    point, seeds = -1, set[int]()
    for chunk in plan.chunks():
        if not counts.get(chunk.point):
            yield chunk
            continue
        if chunk.point != point:
            point, seeds = chunk.point, store.seeds(chunk.point)
        rest = tuple(seed for seed in chunk.seeds if seed not in seeds)
        if rest:
            yield replace(chunk, seeds=rest)


def run_plan(plan: Plan, store: Store, backend: Backend, folder: Path, watch: Watch | None = None) -> None:
    """Does the runs that are missing in the store.

    Raises:
        InputError: a worker has other versions.
        NotPossible: the scheduler went away, or the disk is full; what came is kept.
    """
    store.begin(backend.place, versions())
    total, done, failed = plan.total, sum(store.counts().values()), store.failed()
    todo, back, flying, numbers = missing(plan, store), deque[Chunk](), dict[int, list[Chunk]](), count()
    given_up = Counter[tuple[int, tuple[int, ...]]]()
    begun, before, slots, looked, size = time.monotonic(), done, backend.slots(), time.monotonic(), 1

    def taken() -> list[Chunk]:
        # few at a time towards the end, for no slot to be idle; and of one point, for short runs not to wait for long ones
        most = min(size, 1 + (total - done) // (2 * plan.chunk * max(1, slots)))
        chunks: list[Chunk] = []
        while len(chunks) < most:
            chunk = back.popleft() if back else next(todo, None)
            if chunk is None:
                break
            if chunks and chunk.point != chunks[0].point:
                back.appendleft(chunk)
                break
            chunks.append(chunk)
        return chunks

    def fill() -> None:
        while len(flying) < backend.ahead * max(1, slots) and (chunks := taken()):
            key = next(numbers)
            flying[key] = chunks
            backend.submit(key, [task_of(plan, chunk, folder, backend.strict) for chunk in chunks])

    def say() -> None:
        if watch is not None:
            rate = (done - before) / max(time.monotonic() - begun, 1e-9)
            watch(Progress(done, total, failed, rate, (total - done) / rate if rate > 0 else None, slots))

    fill()
    say()
    while flying:
        rows: list[Row] = []
        for key, replies in backend.wait(LOOK_S):
            chunks = flying.pop(key)
            one = chunks[0].point, chunks[0].seeds
            if _killed(replies[0]):
                given_up[one] += len(chunks) == 1
                if len(chunks) > 1 or given_up[one] < OFTEN:  # one of them may be at fault: which? or none
                    replies = []
            for chunk, reply in zip(chunks, replies, strict=False):
                rows += rows_of(chunk, reply)
            back.extend(chunks[len(replies) :])
            size = min(2 * size, MOST_TOGETHER) if len(replies) == len(chunks) else max(1, len(replies))
        if rows:
            store.add(rows)
            done, failed = done + len(rows), failed + sum(r.error is not None for r in rows)
        if time.monotonic() - looked > LOOK_S:
            slots, looked = backend.slots(), time.monotonic()
        fill()
        say()


def _killed(reply: Any) -> bool:
    """Whether Dask gave up a task because its workers died."""
    return type(reply).__name__ == "KilledWorker"


def rows_of(chunk: Chunk, reply: Any) -> list[Row]:
    """A worker's reply as rows of the store.

    Raises:
        InputError: the worker has other versions.
        NotPossible: the worker itself failed, which says nothing about the runs.
    """
    if _killed(reply):
        return [
            Row(chunk.point, seed, {}, "every worker that began it ended before it was done") for seed in chunk.seeds
        ]
    if isinstance(reply, BaseException):
        message = " ".join(str(reply).split())[:300]
        raise NotPossible(
            f"a worker could not do its work ({type(reply).__name__}: {message}): fix it, then give the same command again; "
            f"finished runs are kept"
        )
    if "differs" in reply:
        check_versions(reply["worker"], reply["differs"])
    return [
        Row(
            point=chunk.point,
            seed=r["seed"],
            data=r["data"],
            error=r["error"],
            wall_s=r["wall_s"],
            cpu_s=r["cpu_s"],
            worker=reply["worker"],
            versions=r["versions"],
        )
        for r in reply["rows"]
    ]
