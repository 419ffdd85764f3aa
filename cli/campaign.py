"""`massprops campaign`: many runs, on this machine or a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops_cli.terminal import say, warn


def command(
    configuration: Annotated[Path, typer.Argument(metavar="CONFIG", help="YAML file: kind, parameters, grid, runs.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Campaign folder; the same command continues a stopped one.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, as tcp://HOST:8786; default: this machine.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; default: one per core.")] = None,
    only: Annotated[int | None, typer.Option(metavar="SEED", help="Make the runs of one seed again, alone.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Consent to more than a million runs.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that this command did not write; never an input.")
    ] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print table.json on stdout and nothing else.")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Run a grid or a random draw of seeded runs into a store that survives, then a table and a report.

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
        raise InputError("-o: give the campaign's folder, or --only SEED to make single runs again")
    from massprops.campaigns.run import run_campaign
    from massprops.campaigns.text import text_of

    with RunProgress(quiet) as watch:
        outcome = run_campaign(plan, out, scheduler, workers, yes, watch, force)
    if len(outcome.versions) > 1:
        warn("the runs of this folder were made with more than one version of the code")
    say(json.dumps(outcome.document) if json_output else text_of(outcome.document))
    if not json_output:
        say(f"report: {outcome.folder / 'report.html'}")
    if outcome.document["failed"] == outcome.document["done"]:
        raise NotPossible("every run failed: the errors are in the report and in runs.csv")
