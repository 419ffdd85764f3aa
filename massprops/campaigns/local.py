"""Runs on this machine, in as many processes as there are workers."""

from __future__ import annotations

import queue
from collections.abc import Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from massprops.campaigns.workers import Closed, Workers


class Local:
    """A backend (see `engine`): each of `count` threads waits for a process of its own."""

    place = "this machine"
    strict = False  # its processes run the installation that this one runs; an edit meanwhile is noted with the rows
    ahead = 2

    def __init__(self, count: int) -> None:
        self.count = count
        self.workers = Workers()
        self.threads = ThreadPoolExecutor(count, thread_name_prefix="campaign")
        self.done: queue.SimpleQueue[tuple[Hashable, list[Any]]] = queue.SimpleQueue()

    def slots(self) -> int:
        """Runs at the same time."""
        return self.count

    def submit(self, key: Hashable, tasks: list[dict[str, Any]]) -> None:
        """Gives chunks to the next free process."""
        self.threads.submit(self._do, key, tasks)

    def _do(self, key: Hashable, tasks: list[dict[str, Any]]) -> None:
        try:
            self.done.put((key, self.workers.do_in_turn(tasks)))
        except Closed:
            pass
        except BaseException as error:
            self.done.put((key, [error]))

    def wait(self, seconds: float) -> list[tuple[Hashable, list[Any]]]:
        """What has come, after at most so long: (key, replies or one exception)."""
        try:
            replies = [self.done.get(timeout=seconds)]
        except queue.Empty:
            return []
        while not self.done.empty():
            replies.append(self.done.get())
        return replies

    def close(self) -> None:
        """Gives up what is in flight and ends every process."""
        self.threads.shutdown(wait=False, cancel_futures=True)
        self.workers.close()
        self.threads.shutdown(wait=True)
