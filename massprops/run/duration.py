"""How long a run will still take, by the times of the stages of the runs that lie beside it."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

from massprops.documents.loading import load_yaml
from massprops.errors import InputError

LEAST_S = 0.05
"""A stage that took less was not computed: it was there from before."""
LEAST_SPENT_S = 5.0
"""What must have been spent before the speed of this run is told from it."""
MOST_RUNS, LARGEST_BYTES = 5, 4_000_000


def earlier_times(run: Path) -> list[dict[str, float]]:
    """Seconds of each stage, in order, of the newest runs that were finished in this folder or beside it."""
    files = [p for p in run.resolve().parent.glob("*/run.yaml") if p.stat().st_size < LARGEST_BYTES]
    seconds_by_run = []
    for path in sorted(files, key=lambda p: -p.stat().st_mtime)[:MOST_RUNS]:
        try:
            stages = load_yaml(path)["stages"]
            times = {str(name): float(entry["seconds"]) for name, entry in stages.items() if entry["status"] == "done"}
        except (InputError, ValueError, KeyError, TypeError, AttributeError):
            continue
        if times:
            seconds_by_run.append(times)
    return seconds_by_run


def left_s(
    earlier: Sequence[Mapping[str, float]], spent: Mapping[str, float], stage: str, since: float
) -> float | None:
    """Seconds that a run still needs, the median of what each earlier run says; None where none says anything.

    An earlier run's remaining stages are taken at this run's speed: the time that this run's stages have taken over
    what they took there.

    Args:
        earlier: seconds by stage of earlier runs, in order.
        spent: seconds of this run's stages that are done.
        stage: the one at work; since: how long it has been [s].
    """
    estimates = []
    for times in earlier:
        if stage not in times:
            continue
        names = list(times)
        here = {n: s for n, s in spent.items() if n in times and s >= LEAST_S}
        there = sum(times[n] for n in here)
        speed = sum(here.values()) / there if there >= LEAST_SPENT_S else 1.0
        rest = names[names.index(stage) + 1 :]
        estimates.append(max(speed * times[stage] - since, 0.0) + speed * sum(times[n] for n in rest))
    return statistics.median(estimates) if estimates else None
