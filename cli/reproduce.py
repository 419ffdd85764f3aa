"""`massprops reproduce`: the tables of the papers, ours beside theirs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops_cli.terminal import say


def command(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="For example pesce2017; a wrong name lists them all.")],
    case: Annotated[
        str | None, typer.Argument(metavar="[CASE]", help="One case; default: all, one after another.")
    ] = None,
    runs: Annotated[
        int | None, typer.Option(help="Runs per case; default: the paper's number where it is feasible.")
    ] = None,
    seed: Annotated[int, typer.Option(help="The first run's seed.")] = 0,
    only: Annotated[int | None, typer.Option(metavar="SEED", help="Make the run of one seed again, alone.")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Campaign folder to keep; needed to continue a stopped one.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, as tcp://HOST:8786; default: this machine.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; default: one per core.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Consent to more than a million runs.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the result on stdout and nothing else.")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Run a paper's cases and print its tables, ours beside the paper's.

    Example: massprops reproduce pesce2017 C --runs 100 -o runs/pesce-c
    """
    import json

    from massprops.campaigns.papers import SPEED, load_paper
    from massprops.campaigns.reproduce import reproduce_plan, reproduced, speed_of

    if case == SPEED and hasattr(load_paper(paper), SPEED):
        found = speed_of(paper)
        say(json.dumps(found) if json_output else "\n".join(f"{k}: {v}" for k, v in found.items()))
        return
    from massprops.campaigns.text import text_of
    from massprops_cli.campaign_progress import RunProgress, alone

    plan = reproduce_plan(paper, case, runs, seed)
    if only is not None:
        alone(plan, only, out, scheduler, workers, json_output)
        return
    with RunProgress(quiet) as watch:
        outcome = reproduced(plan, out, scheduler, workers, yes, watch)
    say(json.dumps(outcome.document) if json_output else text_of(outcome.document))
    if not json_output and out is not None:
        say(f"report: {outcome.folder / 'report.html'}")
