"""`massprops mass`: mass properties of a finished mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops_cli.terminal import say, warn


def command(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Closed mesh: STL, OBJ, PLY, GLB or OFF.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Run folder.")],
    density: Annotated[
        float | None, typer.Option(help="Constant density [kg/m^3]; not given: 1000, as water, and said so.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit of the file; 0.001 for millimetres.")] = 1.0,
    scale_sigma: Annotated[float, typer.Option(help="Relative 1-sigma of the scale.")] = 0.0,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files and results that this command did not write; never MESH.")
    ] = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print massprops.json on stdout and nothing else.")
    ] = False,
) -> None:
    """Volume, centre of mass and inertia of a mesh, with the same report and exports as a reconstruction.

    Example: massprops mass part.stl -o runs/part --density 2700 --scale 0.001
    """
    import json

    from massprops.run.from_mesh import mass
    from massprops_cli.table import mass_table

    run = mass(mesh, out, density, scale, scale_sigma, force)
    for warning in run.warnings:
        warn(warning)
    say(json.dumps(run.properties) if json_output else mass_table(run.properties))
    if not json_output:
        say(f"report: {run.folder / 'report.html'}")
