"""Progress of a run on stderr: a live line on a terminal; elsewhere a line per stage, and one every ten seconds."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from massprops.core.text import clean, clock

BEAT_S = 10.0
"""Without a terminal, a line at least so often."""


class StageProgress:
    """A `Watch` for `run_stages`; use as a context manager."""

    def __init__(self, quiet: bool, run: Path | None = None, now: Callable[[], float] = time.monotonic) -> None:
        """Args: run: the run folder, whose neighbours tell how long it will take; now: the clock."""
        self.quiet, self.now = quiet, now
        self.live = not quiet and sys.stderr.isatty()
        self.bar: Any = None
        self.stage, self.title, self.what = "", "", ""
        self.begun = self.entered = now()
        self.last_said = -BEAT_S
        self.spent: dict[str, float] = {}
        self.earlier: list[dict[str, float]] = []
        self.run, self.over = run, threading.Event()

    def __enter__(self) -> StageProgress:
        if self.run is not None and not self.quiet:
            from massprops.run.duration import earlier_times

            self.earlier = earlier_times(self.run)
        if self.live:
            self._start_bar()
        elif not self.quiet:
            threading.Thread(target=self._beat_on, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over.set()
        if self.bar is not None:
            self.bar.stop()

    def __call__(self, stage: str, number: int, count: int, done: int, total: int, what: str) -> None:
        if self.quiet:
            return
        new = stage != self.stage
        if new:
            if self.stage:
                self.spent[self.stage] = self.now() - self.entered
            self.entered = self.now()
        self.stage, self.title = stage, f"[{number + 1}/{count}] {clean(stage)}"
        self.what = _part(clean(what), done, total)
        if self.bar is not None:
            if new:
                self.task = self.bar.add_task(self.title, total=None, left="")
            text = f"{self.title} {clean(what)}".rstrip()[:60]
            self.bar.update(self.task, description=text, completed=done, total=total or None, left=self.left())
        elif new:
            self.tell(f"{self.title}{self.left()}")

    def left(self) -> str:
        """What is left of the whole run, where earlier runs say it."""
        if not self.earlier:
            return ""
        from massprops.run.duration import left_s

        seconds = left_s(self.earlier, self.spent, self.stage, self.now() - self.entered)
        return "" if seconds is None else f", about {clock(seconds)} left"

    def beat(self) -> None:
        """Says where the run is, when nothing has been said for a while."""
        if self.stage and self.now() - self.last_said >= BEAT_S:
            self.tell(f"{self.title} {self.what}".rstrip() + self.left())

    def tell(self, text: str) -> None:
        """One line with the time since the start."""
        self.last_said = self.now()
        print(f"{self.last_said - self.begun:7.1f} s  {text}", file=sys.stderr, flush=True)

    def _beat_on(self) -> None:
        while not self.over.wait(1.0):
            self.beat()

    def _start_bar(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self.bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}", markup=False),
            console=Console(stderr=True),
            transient=False,
        )
        self.bar.start()


def _part(what: str, done: int, total: int) -> str:
    """How far a part of a stage is; of a finished one, that it is finished: what follows may report nothing of its own."""
    if total <= 1:
        return what
    return f"{what} done".strip() if done >= total else f"{what} {done}/{total}".strip()
