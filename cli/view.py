"""`massprops view`: the report in the browser; a list of runs, or two beside one another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops.core.outputs import verify
from massprops.errors import InputError
from massprops_cli.terminal import say


def command(
    run: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="A run folder, a folder of runs, or two runs to compare.")
    ],
) -> None:
    """Open the report of a run in the browser, a list of all runs in a folder, or a comparison of two runs.

    If there is no browser, the path of the page is printed.

    Example: massprops view runs/demo

    Example: massprops view runs/one runs/two
    """
    import webbrowser

    page = _page(run)
    try:
        opened = webbrowser.open(page.resolve().as_uri())
    except webbrowser.Error:
        opened = False
    say(f"{'opened' if opened else 'open this in a browser:'} {page.resolve()}")


def _page(runs: list[Path]) -> Path:
    if len(runs) > 2:
        raise InputError(f"{len(runs)} folders: give one run, one folder of runs, or two runs to compare")
    for run in runs:
        if not run.is_dir():
            raise InputError(f"{run}: no such folder")
    if len(runs) == 1 and (runs[0] / "report.html").is_file():
        verify(runs[0], "report.html")
        return runs[0] / "report.html"
    from massprops.report.runs import runs_in, write_runs

    if len(runs) == 2:
        return write_runs(runs[0].resolve().parent, runs)
    folders = runs_in(runs[0])
    if not folders:
        raise InputError(
            f"{runs[0]}: no report.html and no runs in this folder; make a run first with 'massprops reconstruct'"
        )
    return write_runs(runs[0], folders)
