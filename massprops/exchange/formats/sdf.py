"""SDFormat (Gazebo, Drake): one link.

`<inertia>` is about the centre of mass in the axes of the inertial `<pose>`, products as -int x y dm, as the
specification says.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import escape

from massprops.exchange.body import Body, xml_comment

NAME = "sdf"
SUFFIX = ".sdf"
NEEDS_METRES = True
MESHES = True


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The model as text."""
    x, y, z = (f"{v:.17g}" for v in body.center_of_mass)
    inertia = "".join(f"          <{n}>{v:.17g}</{n}>\n" for n, v in body.elements.items())
    shapes = "".join(
        f'      <{tag} name="{tag}">\n        <geometry><mesh><uri>{escape(meshes[tag])}</uri></mesh></geometry>\n      </{tag}>\n'
        for tag in ("visual", "collision")
        if tag in meshes
    )
    return (
        f'<?xml version="1.0"?>\n{xml_comment(body)}\n<sdf version="1.9">\n  <model name="{body.name}">\n'
        f'    <link name="{body.name}">\n      <inertial>\n        <pose>{x} {y} {z} 0 0 0</pose>\n'
        f"        <mass>{body.mass:.17g}</mass>\n        <inertia>\n{inertia}        </inertia>\n      </inertial>\n"
        f"{shapes}    </link>\n  </model>\n</sdf>\n"
    )
