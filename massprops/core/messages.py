"""Messages between a process and its child: one line of JSON each, over a pipe."""

from __future__ import annotations

import json
import os
import select
import time
from collections.abc import Callable
from typing import Any

HANDLE = "MASSPROPS_PIPE"
"""The variable by which a child process learns where its messages go."""


class Silence(Exception):
    """No message came: `why` is "ended", "time", or what `watch` said."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why


def sayer(handle: int) -> Callable[[dict[str, Any]], None]:
    """The child's end: a function that sends a message of plain values."""
    pipe = os.fdopen(handle, "w")

    def say(content: dict[str, Any]) -> None:
        pipe.write(json.dumps(content) + "\n")
        pipe.flush()

    return say


class Listener:
    """The parent's end of a pipe."""

    def __init__(self, handle: int) -> None:
        self.handle, self._left = handle, b""

    def next(
        self, seconds: float | None = None, watch: Callable[[], str] | None = None, every: float = 0.05
    ) -> dict[str, Any]:
        """The next message.

        Args:
            seconds: longest time to wait. watch: asked `every` so many seconds; a text other than "" ends the waiting.

        Raises:
            Silence: the pipe ended, the time is over, or `watch` said so.
        """
        end = None if seconds is None else time.monotonic() + seconds
        while b"\n" not in self._left:
            wait = None if end is None else end - time.monotonic()
            if wait is not None and wait <= 0:
                raise Silence("time")
            if watch is not None:
                wait = every if wait is None else min(wait, every)
            if select.select([self.handle], [], [], wait)[0]:
                part = os.read(self.handle, 1 << 20)
                if not part:
                    raise Silence("ended")
                self._left += part
            if watch is not None and (why := watch()):
                raise Silence(why)
        line, _, self._left = self._left.partition(b"\n")
        message: dict[str, Any] = json.loads(line)
        return message
