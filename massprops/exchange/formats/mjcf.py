"""MJCF (MuJoCo): one free body.

`fullinertia` is M11 M22 M33 M12 M13 M23, tensor elements about `pos` in the body's axes: another order than URDF's.
The mesh is a visual only; contacts use the collision mesh. Gravity is off, as for a free-flying body.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import escape

from massprops.exchange.body import Body, xml_comment

NAME = "mjcf"
SUFFIX = ".xml"
NEEDS_METRES = True
MESHES = True
QUOTE = {'"': "&quot;"}


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The model as text."""
    J = body.inertia
    full = " ".join(f"{v:.17g}" for v in (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]))
    position = " ".join(f"{v:.17g}" for v in body.center_of_mass)
    assets = "".join(f'    <mesh name="{tag}" file="{escape(path, QUOTE)}"/>\n' for tag, path in meshes.items())
    geoms = ""
    if "visual" in meshes:
        geoms += '      <geom type="mesh" mesh="visual" contype="0" conaffinity="0" group="2" mass="0"/>\n'
    if "collision" in meshes:
        geoms += '      <geom type="mesh" mesh="collision" group="3" mass="0"/>\n'
    return (
        f"{xml_comment(body)}\n"
        f'<mujoco model="{body.name}">\n  <compiler angle="radian" inertiafromgeom="false" balanceinertia="false"/>\n'
        f'  <option gravity="0 0 0" integrator="RK4" timestep="0.01"/>\n  <asset>\n{assets}  </asset>\n'
        f'  <worldbody>\n    <light pos="0 0 10" directional="true"/>\n    <body name="{body.name}">\n      <freejoint/>\n'
        f'      <inertial pos="{position}" mass="{body.mass:.17g}" fullinertia="{full}"/>\n{geoms}'
        f"    </body>\n  </worldbody>\n</mujoco>\n"
    )
