"""`massprops view`: the report in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops.core.outputs import verify
from massprops.errors import InputError
from massprops_cli.terminal import say


def command(run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")]) -> None:
    """Open a run's report in the browser; where there is none, print its path.

    Example: massprops view runs/demo
    """
    import webbrowser

    page = run / "report.html"
    if not page.is_file():
        raise InputError(f"{run}: no report.html in this folder: make the run first with 'massprops reconstruct'")
    verify(run, page.name)
    try:
        opened = webbrowser.open(page.resolve().as_uri())
    except webbrowser.Error:
        opened = False
    say(f"{'opened' if opened else 'open this in a browser:'} {page.resolve()}")
