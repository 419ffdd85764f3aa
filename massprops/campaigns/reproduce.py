"""The cases of a paper as a campaign; the configuration is part of the package."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from massprops.campaigns.configuration import Plan, plan_of
from massprops.campaigns.engine import Watch
from massprops.campaigns.papers import SPEED, checked_case, load_paper
from massprops.campaigns.run import Outcome, run_campaign
from massprops.core.files import plain


def reproduce_plan(paper: str, case: str | None = None, runs: int | None = None, seed: int = 0) -> Plan:
    """The plan of one case, or of all.

    Args:
        runs: runs per case; None takes the paper file's number of each case.

    Raises:
        InputError: unknown paper or case, or a number out of range.
    """
    module = load_paper(paper)
    cases = [checked_case(module, case)] if case is not None else list(module.CASES)
    content: dict[str, Any] = {"kind": "paper", "paper": paper, "name": paper, "grid": {"case": cases}, "seed": seed}
    if runs is not None:
        content["runs"] = runs
    return plan_of(content, f"reproduce {paper}" + (f" {case}" if case else ""))


def reproduced(
    plan: Plan,
    out: str | Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    yes: bool = False,
    watch: Watch | None = None,
) -> Outcome:
    """Runs the plan; without `out` in a folder that goes away. Arguments and errors as `run_campaign`."""
    if out is not None:
        return run_campaign(plan, out, scheduler, workers, yes, watch)
    with tempfile.TemporaryDirectory(prefix="massprops-") as spare:
        return run_campaign(plan, spare, scheduler, workers, yes, watch)


def speed_of(paper: str) -> dict[str, Any]:
    """The benchmark of a paper's file, measured now on this machine."""
    benchmark: dict[str, Any] = plain(getattr(load_paper(paper), SPEED)())
    return benchmark
