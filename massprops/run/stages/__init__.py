"""One file per stage of a reconstruction, in the order in which they run.

A stage file declares READS (stages whose folders it reads), OPTIONS (fields of `ReconstructOptions` that it depends
on) and `run(job) -> dict` of small facts for `run.yaml`. It writes into `job.out` only.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol, cast

from massprops.run.job import Job

ORDER = (
    "capture", "sfm", "shape", "silhouettes", "join", "dense", "surface", "scale", "mass", "colour", "sequence", "publish",
    "crosscheck", "report",
)  # fmt: skip

ALWAYS = ("publish", "report")
"""Stages that run on whatever there is, even when an earlier one could not finish."""

EXTRA = ("colour", "crosscheck")
"""Stages whose failure is a warning: the run's own results stand without them."""


class Stage(Protocol):
    """What such a file holds."""

    READS: tuple[str, ...]
    OPTIONS: tuple[str, ...]

    def run(self, job: Job) -> dict[str, Any] | None:
        """See the top of this file."""
        ...


def load_stage(name: str, package: str = __name__) -> Stage:
    """The module of one stage."""
    return cast(Stage, import_module(f"{package}.{name}"))
