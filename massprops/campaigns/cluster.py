"""Runs on an existing Dask cluster: each chunk is a task, done in a child process of its worker."""

from __future__ import annotations

import contextlib
import queue
import threading
from asyncio import CancelledError
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import Any

from massprops.campaigns.versions import difference, versions
from massprops.campaigns.workers import Workers
from massprops.errors import InputError, MasspropsError, NotPossible

ANSWER_S = 6.0
"""How long a scheduler may take to answer."""
REACH_S = 60.0
"""How long a worker's answer may take to here; by Dask's own settings it is knocked at for 30 s."""

_workers: list[Workers] = []


def do_on_worker(tasks: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Chunks of runs, on a Dask worker."""
    if not _workers:
        _workers.append(Workers())
    return _workers[0].do_in_turn(tasks)


def _answers() -> bool:
    """A question that every reachable worker answers."""
    return True


def _check_scheduler(address: str) -> None:
    """Checks that a Dask scheduler listens at the address, in a separate thread, since another server may never answer.

    Raises:
        InputError: no answer in time, or not a scheduler's.
    """
    import asyncio

    from distributed.comm.core import connect

    async def ask() -> Any:
        comm = await connect(address, timeout=ANSWER_S)
        try:
            await comm.write({"op": "identity", "reply": True})
            return await comm.read()
        finally:
            comm.abort()

    answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def run() -> None:
        try:
            answers.put(asyncio.run(asyncio.wait_for(ask(), ANSWER_S)))
        except Exception as error:
            answers.put(error)

    threading.Thread(target=run, daemon=True).start()
    try:
        answer = answers.get(timeout=ANSWER_S + 1.0)
    except queue.Empty:
        answer = TimeoutError()
    if isinstance(answer, OSError):  # TimeoutError is one
        raise InputError(
            f"--scheduler {address}: no answer within {ANSWER_S:g} s: is it running, and is the address right?"
        )
    if not isinstance(answer, dict) or "workers" not in answer:
        detail = f" ({_line(answer)})" if isinstance(answer, BaseException) else ""
        raise InputError(f"--scheduler {address}: not a Dask scheduler{detail}: give its address as tcp://HOST:8786")


class Cluster:
    """A backend (see `engine`) on the workers of a scheduler."""

    strict = True
    ahead = 8  # a task's way from here to a worker and back takes longer than a short chunk

    def __init__(self, address: str) -> None:
        """Connects.

        Raises:
            InputError: dask.distributed is missing here, no answer, no workers, or workers with other versions.
            NotPossible: the scheduler ends, or is too slow, while it is asked.
        """
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                "--scheduler needs dask.distributed: pip install 'massprops[cluster]', or leave --scheduler out"
            ) from None
        import logging

        for name in ("distributed", "distributed.client", "distributed.comm", "distributed.core"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self.place = address
        self.deaf: set[str] = set()
        _check_scheduler(address)
        with self._heard():
            self.client = Client(address, timeout=ANSWER_S, set_as_default=False, name="massprops")
        try:
            with self._heard():
                self._check_workers()
        except BaseException:
            with contextlib.suppress(Exception):
                self.client.close(timeout=2)
            raise
        self.done: queue.SimpleQueue[tuple[Hashable, Any]] = queue.SimpleQueue()
        self.flying: dict[Hashable, tuple[Any, list[dict[str, Any]]]] = {}
        self.sent = 0
        self.session = self.client.id.rsplit("-", 1)[-1]

    def _check_workers(self) -> None:
        with contextlib.suppress(TimeoutError, OSError):
            self.client.wait_for_workers(1, timeout=ANSWER_S)
        threads = self.client.nthreads()
        if not threads:
            raise InputError(
                f"--scheduler {self.place}: it has no workers: start some with `dask worker {self.place} --nthreads 1`"
            )
        worker_answers = self._ask_each(versions, threads)
        if len(self.deaf) == len(worker_answers):
            raise InputError(
                f"--scheduler {self.place}: it can reach none of its {len(worker_answers)} workers: open their ports to it (option "
                "--worker-port of dask worker)"
            )
        for address, theirs in worker_answers.items():
            if address in self.deaf:
                continue
            if isinstance(theirs, BaseException):
                raise InputError(
                    f"worker {address}: massprops cannot be used there ({_line(theirs)}): install the same version"
                )
            check_versions(address, theirs)

    def _ask_each(self, what: Callable[[], Any], workers: Iterable[str]) -> dict[str, Any]:
        """The answer of each worker to a function, or its exception. A worker that cannot be reached is marked `deaf`.

        Its heartbeats still arrive, so Dask would ask it for ever. It gets no more work.
        """
        import asyncio

        addresses = sorted(workers)

        async def all_of_them() -> list[Any]:
            asked = [self.client.run(what, workers=[address], on_error="return") for address in addresses]
            return await asyncio.gather(*(asyncio.wait_for(a, REACH_S) for a in asked), return_exceptions=True)

        answers = dict(zip(addresses, self.client.sync(all_of_them), strict=True))
        worker_answers = {
            a: answer.get(a, OSError("gone")) if isinstance(answer, dict) else answer for a, answer in answers.items()
        }
        self.deaf |= {address for address, answer in worker_answers.items() if isinstance(answer, OSError)}
        return worker_answers

    def slots(self) -> int:
        """Number of runs at the same time: the threads of all workers that can be reached now."""
        return sum(self._reached().values())

    def _reached(self) -> dict[str, int]:
        """Threads of each worker that can be reached now, by address."""
        with self._heard():
            return {address: n for address, n in self.client.nthreads().items() if address not in self.deaf}

    def submit(self, key: Hashable, tasks: list[dict[str, Any]]) -> None:
        """Gives chunks to the scheduler. If a worker dies, another one does its chunks."""
        self.sent += 1
        where = self._reached() if self.deaf else []
        with self._heard():
            future = self.client.submit(
                do_on_worker, tasks, key=f"massprops-{self.session}-{self.sent}", pure=False,
                workers=list(where) or None, allow_other_workers=bool(where),
            )  # fmt: skip
        self.flying[key] = (future, tasks)
        future.add_done_callback(lambda done: self.done.put((key, done)))

    def wait(self, seconds: float) -> list[tuple[Hashable, list[Any]]]:
        """What has come, after at most so long: (key, replies or one exception); all come in one message."""
        try:
            ended = [self.done.get(timeout=seconds)]
        except queue.Empty:
            if self.client.status not in ("running", "connecting"):
                raise self._lost(self.client.status) from None
            return []
        while not self.done.empty():
            ended.append(self.done.get())
        # of a key given out again, the future of before says nothing any more
        ended = [(key, future) for key, future in ended if self.flying.get(key, (None,))[0] is future]
        good = [(key, future) for key, future in ended if future.status == "finished"]
        replies: list[tuple[Hashable, list[Any]]] = []
        for key, future in ended:
            if future.status in ("cancelled", "lost"):
                raise self._lost(future.status)
            if future.status == "error":
                replies.append((key, [future.exception()]))
        replies += zip([key for key, _ in good], self._gathered([future for _, future in good]), strict=False)
        for key, _ in replies:
            self.flying.pop(key, None)
        for key, _ in good:
            if key in self.flying:
                self._give_out_again(key)
        return replies

    def _gathered(self, futures: list[Any]) -> list[Any]:
        """Results of finished tasks; none where a worker that has some cannot be reached."""
        try:
            return list(
                self.client.sync(lambda: self.client.gather(futures, asynchronous=True), callback_timeout=REACH_S)
            )
        except TimeoutError:
            pass
        except (Exception, CancelledError) as error:
            raise self._lost(error) from None
        with self._heard():
            self._ask_each(_answers, {a for places in self.client.who_has(futures).values() for a in places})
        return []

    def _give_out_again(self, key: Hashable) -> None:
        future, tasks = self.flying[key]
        with self._heard():
            future.cancel()
        self.submit(key, tasks)

    @contextlib.contextmanager
    def _heard(self) -> Iterator[None]:
        """What Dask raises where the scheduler ends, or is too slow, while it is talked to, has many kinds."""
        try:
            yield
        except MasspropsError:
            raise
        except (Exception, CancelledError) as error:
            raise self._lost(error) from None

    def _lost(self, why: object) -> NotPossible:
        return NotPossible(
            f"the scheduler at {self.place} went away ({_line(why)}): start it and give the same command again; finished "
            "runs are kept"
        )

    def close(self) -> None:
        """Cancels the chunks that are still waiting."""
        with contextlib.suppress(Exception):
            if self.flying:
                self.client.cancel([future for future, _ in self.flying.values()], asynchronous=False)
            self.client.close(timeout=2)


def check_versions(worker: str, theirs: dict[str, str]) -> None:
    """Refuses a worker with other versions than here.

    Raises:
        InputError: they differ.
    """
    differs = difference(versions(), theirs)
    if differs:
        raise InputError(f"worker {worker}: versions differ ({differs}): install the same on both")


def _line(error: object) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
