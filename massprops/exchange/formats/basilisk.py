"""Basilisk: a Python file that sets the hub of a `spacecraft.Spacecraft`.

`IHubPntBc_B` is the full tensor about the centre of mass Bc in the axes B, row by row; `r_BcB_B` is the centre of
mass from the mesh's origin B, a column.
"""

from __future__ import annotations

from collections.abc import Mapping

from massprops.exchange.body import Body

NAME = "basilisk"
SUFFIX = ".py"
NEEDS_METRES = True
MESHES = False


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The file as text; importing it needs no Basilisk."""
    rows = ",\n    ".join("[" + ", ".join(f"{v:.17g}" for v in row) + "]" for row in body.inertia)
    centre = ", ".join(f"[{v:.17g}]" for v in body.center_of_mass)
    remarks = "\n".join(body.remarks).replace("\\", "/").replace('"""', "")
    return (
        f'"""{body.name} for Basilisk, SI units.\n\n{remarks}\n\n'
        f"Use: `from Basilisk.simulation import spacecraft; sc = spacecraft.Spacecraft(); apply(sc.hub)`.\n"
        f'"""\n\nM_HUB = {body.mass:.17g}  # kg\nR_BCB_B = [{centre}]  # m\nI_HUB_PNT_BC_B = [\n    {rows},\n]  # kg m^2\n\n\n'
        f"def apply(hub):\n"
        f'    """Gives the hub this body\'s mass, centre of mass and inertia."""\n'
        f"    hub.mHub = M_HUB\n    hub.r_BcB_B = R_BCB_B\n    hub.IHubPntBc_B = I_HUB_PNT_BC_B\n"
    )
