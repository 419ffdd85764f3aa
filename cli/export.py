"""`massprops export`: a run or a mesh into a file that another program reads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops_cli.terminal import say, warn


def command(
    source: Annotated[Path, typer.Argument(metavar="RUN_OR_MESH", help="Run folder, or a mesh file in metres.")],
    to: Annotated[str, typer.Option("--to", help="filter, urdf, mjcf, sdf, basilisk, csv or json.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="File to write; default: in the run, by its name.")
    ] = None,
    density: Annotated[
        float | None, typer.Option(help="For a mesh file [kg/m^3]; not given: 1000, as water, and said so.")
    ] = None,
    mass: Annotated[float | None, typer.Option(help="Measured mass [kg]; the inertia is scaled to it.")] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that this command did not write; never an input.")
    ] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the written path as JSON.")] = False,
) -> None:
    """Write mass properties for a filter or a simulator.

    Example: massprops export runs/demo --to mjcf -o satellite.xml
    """
    import json

    from massprops.exchange.export import export

    path = export(source, to, out, density, mass, warn, force)
    say(json.dumps({"file": str(path), "format": to}) if json_output else f"{to}: {path}")
