"""What `campaign` and `reproduce` share: progress on stderr, and single runs."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from massprops.core.text import clock
from massprops_cli.terminal import say

if TYPE_CHECKING:
    from massprops.campaigns.configuration import Plan
    from massprops.campaigns.engine import Progress

SAY_S = 10.0
"""Without a terminal, one line so often."""


class RunProgress:
    """A `Watch` of a campaign: a live line on a terminal, a line now and then elsewhere; use as a context manager."""

    def __init__(self, quiet: bool) -> None:
        self.quiet = quiet
        self.live = not quiet and sys.stderr.isatty()
        self.last_said = -SAY_S
        self.width = 0

    def __enter__(self) -> RunProgress:
        return self

    def __exit__(self, *_: object) -> None:
        if self.width:
            print(file=sys.stderr)

    def __call__(self, now: Progress) -> None:
        if self.quiet:
            return
        line = progress_line(now)
        if self.live:
            print("\r" + line.ljust(self.width), end="", file=sys.stderr, flush=True)
            self.width = len(line)
        elif time.monotonic() - self.last_said >= SAY_S or now.done == now.total:
            self.last_said = time.monotonic()
            print(line, file=sys.stderr, flush=True)


def progress_line(now: Progress) -> str:
    """Done, failed, rate and time left in one line."""
    parts = [f"{now.done}/{now.total} runs"]
    if now.failed:
        parts.append(f"{now.failed} failed")
    if now.rate > 0:
        parts.append(f"{now.rate:.3g} runs/s")
    if now.left_s is not None and now.done < now.total:
        parts.append(f"{clock(now.left_s)} left")
    parts.append(f"{now.slots} workers" if now.slots != 1 else "1 worker")
    return ", ".join(parts)


def alone(
    plan: Plan, seed: int, out: Path | None, scheduler: str | None, workers: int | None, json_output: bool
) -> None:
    """Makes the runs of one seed again and prints their rows."""
    import json

    from massprops.campaigns.run import run_alone
    from massprops.campaigns.text import cell_text

    points = run_alone(plan, seed, out, scheduler, workers)
    if json_output:
        say(json.dumps([{"point": p.cell, **row} for p in points for row in p.dictionaries()]))
        return
    for point in points:
        for row in point.dictionaries():
            say(f"{point.label}, seed {seed}")
            for name, value in row.items():
                if name != "seed":
                    say(f"  {name:<28}{cell_text(value)}")
