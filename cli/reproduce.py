"""`massprops reproduce`: the tables of the papers, ours beside theirs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from massprops import reproduce
from massprops_cli.options import Quiet, argument, as_json, defaults, option, takes
from massprops_cli.terminal import say

D = defaults(reproduce)


@dataclass(frozen=True)
class Options:
    paper: Annotated[str, argument(reproduce, "paper", "PAPER")]
    case: Annotated[str | None, argument(reproduce, "case", "[CASE]")] = D.case
    out: Annotated[Path | None, option(reproduce, "out", "-o", "--out")] = D.out
    runs: Annotated[int | None, option(reproduce, "runs")] = D.runs
    seed: Annotated[int, option(reproduce, "seed")] = D.seed
    only: Annotated[
        int | None, typer.Option(metavar="SEED", help="Repeat only the runs of this seed, and print them.")
    ] = None
    scheduler: Annotated[str | None, option(reproduce, "scheduler", metavar="ADDRESS")] = D.scheduler
    workers: Annotated[int | None, option(reproduce, "workers")] = D.workers
    yes: Annotated[bool, option(reproduce, "yes", "--yes")] = D.yes
    json_output: Annotated[bool, as_json("the result")] = False
    quiet: Quiet = False


@takes(Options)
def command(given: Options) -> None:
    """Run the cases of a paper and print its tables, our numbers beside the paper's.

    Example: massprops reproduce pesce2017 C --runs 100 -o runs/pesce-c
    """
    import json

    from massprops.campaigns.papers import SPEED, load_paper
    from massprops.campaigns.reproduce import reproduce_plan, reproduced, speed_of

    if given.case == SPEED and hasattr(load_paper(given.paper), SPEED):
        speeds = speed_of(given.paper)
        say(json.dumps(speeds) if given.json_output else "\n".join(f"{k}: {v}" for k, v in speeds.items()))
        return
    from massprops.campaigns.text import text_of
    from massprops_cli.campaign_progress import RunProgress, alone

    plan = reproduce_plan(given.paper, given.case, given.runs, given.seed)
    if given.only is not None:
        alone(plan, given.only, given.out, given.scheduler, given.workers, given.json_output)
        return
    with RunProgress(given.quiet) as watch:
        outcome = reproduced(plan, given.out, given.scheduler, given.workers, given.yes, watch)
    say(json.dumps(outcome.document) if given.json_output else text_of(outcome.document))
    if not given.json_output and given.out is not None:
        say(f"report: {outcome.folder / 'report.html'}")
