"""`massprops mass`: mass properties of a finished mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from massprops import mass_properties
from massprops_cli.options import Force, argument, as_json, defaults, option
from massprops_cli.terminal import say, warn, warn_of_density

D = defaults(mass_properties)


def command(
    mesh: Annotated[Path, argument(mass_properties, "mesh", "MESH")],
    out: Annotated[Path, option(mass_properties, "out", "-o", "--out")],
    density: Annotated[float | None, option(mass_properties, "density")] = D.density,
    scale: Annotated[float, option(mass_properties, "scale")] = D.scale,
    scale_sigma: Annotated[float, option(mass_properties, "scale_sigma")] = D.scale_sigma,
    force: Force = False,
    json_output: Annotated[bool, as_json("massprops.json")] = False,
) -> None:
    """Volume, centre of mass and inertia of a finished mesh, with the same report and exports as a reconstruction.

    Example: massprops mass part.stl -o runs/part --density 2700 --scale 0.001
    """
    import json

    from massprops.run.from_mesh import mass
    from massprops_cli.table import mass_table

    run = mass(mesh, out, density, scale, scale_sigma, force)
    for warning in run.warnings:
        warn(warning)
    warn_of_density(run.density_assumed)
    say(json.dumps(run.properties) if json_output else mass_table(run.properties))
    if not json_output:
        say(f"report: {run.folder / 'report.html'}")
