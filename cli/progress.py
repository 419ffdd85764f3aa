"""Progress of a run on stderr: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time

from massprops.core.text import clean


class StageProgress:
    """A `Watch` for `run_stages`; use as a context manager."""

    def __init__(self, quiet: bool) -> None:
        self.quiet = quiet
        self.live = not quiet and sys.stderr.isatty()
        self.bar = None
        self.stage = ""
        self.begun = time.monotonic()

    def __enter__(self) -> StageProgress:
        if self.live:
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                MofNCompleteColumn,
                Progress,
                TextColumn,
                TimeElapsedColumn,
                TimeRemainingColumn,
            )

            self.bar = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=False,
            )
            self.bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()

    def __call__(self, stage: str, number: int, count: int, done: int, total: int, what: str) -> None:
        if self.quiet:
            return
        title, what = f"[{number + 1}/{count}] {clean(stage)}", clean(what)
        if self.bar is not None:
            if stage != self.stage:
                self.task = self.bar.add_task(title, total=None)
            self.bar.update(self.task, description=f"{title} {what}".rstrip()[:60], completed=done, total=total or None)
        elif stage != self.stage:
            print(f"{time.monotonic() - self.begun:7.1f} s  {title}", file=sys.stderr, flush=True)
        self.stage = stage
