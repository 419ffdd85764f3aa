"""`massprops export`: a run or a mesh into a file that another program reads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops import export
from massprops_cli.options import Force, argument, defaults, option
from massprops_cli.terminal import say, warn, warn_of_density

D = defaults(export)


def command(
    source: Annotated[Path, argument(export, "source", "RUN_OR_MESH")],
    to: Annotated[str, option(export, "to")],
    out: Annotated[Path | None, option(export, "out", "-o", "--out")] = D.out,
    density: Annotated[float | None, option(export, "density")] = D.density,
    mass: Annotated[float | None, option(export, "mass")] = D.mass,
    force: Force = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the written path as JSON.")] = False,
) -> None:
    """Write mass properties, or a run's cameras, in the format of another program.

    Example: massprops export runs/demo --to mjcf -o satellite.xml
    """
    import json

    from massprops.exchange.export import export

    path = export(source, to, out, density, mass, warn, force)
    warn_of_density(density is None and mass is None and source.is_file())
    say(json.dumps({"file": str(path), "format": to}) if json_output else f"{to}: {path}")
