"""`massprops campaign`: many runs, on this machine or a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops import campaign
from massprops_cli.options import Force, Quiet, argument, as_json, defaults, option
from massprops_cli.terminal import say, warn

D = defaults(campaign)


def command(
    configuration: Annotated[Path, argument(campaign, "configuration", "CONFIG")],
    out: Annotated[Path | None, option(campaign, "out", "-o", "--out")] = D.out,
    scheduler: Annotated[str | None, option(campaign, "scheduler", metavar="ADDRESS")] = D.scheduler,
    workers: Annotated[int | None, option(campaign, "workers")] = D.workers,
    only: Annotated[
        int | None, typer.Option(metavar="SEED", help="Repeat only the runs of this seed, and print them.")
    ] = None,
    yes: Annotated[bool, option(campaign, "yes", "--yes")] = D.yes,
    force: Force = False,
    json_output: Annotated[bool, as_json("table.json")] = False,
    quiet: Quiet = False,
) -> None:
    """Run many seeded cases, from a grid or drawn at random, and summarise them in a table and a report.

    Finished runs are stored at once, so that a stopped campaign continues where it was.

    Example: massprops campaign study.yaml -o runs/study --workers 4
    """
    import json

    from massprops.campaigns.configuration import read_configuration
    from massprops.errors import InputError, NotPossible
    from massprops_cli.campaign_progress import RunProgress, alone

    plan = read_configuration(configuration)
    if only is not None:
        alone(plan, only, out, scheduler, workers, json_output)
        return
    if out is None:
        raise InputError("give -o FOLDER for the campaign, or --only SEED to repeat single runs")
    from massprops.campaigns.run import run_campaign
    from massprops.campaigns.text import text_of

    with RunProgress(quiet) as watch:
        outcome = run_campaign(plan, out, scheduler, workers, yes, watch, force)
    if len(outcome.versions) > 1:
        warn("the runs in this folder were made with more than one version of massprops")
    say(json.dumps(outcome.document) if json_output else text_of(outcome.document))
    if not json_output:
        say(f"report: {outcome.folder / 'report.html'}")
    if outcome.document["failed"] == outcome.document["done"]:
        raise NotPossible("every run failed; the errors are in the report and in runs.csv")
