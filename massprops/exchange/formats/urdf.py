"""URDF (ROS, Gazebo, PyBullet, Drake): one link.

`<inertial>` is about the centre of mass in the axes of its origin; the six values are tensor elements
(`ixy` = -int x y dm). The link frame is the mesh's.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import escape

from massprops.exchange.body import Body, xml_comment

NAME = "urdf"
SUFFIX = ".urdf"
NEEDS_METRES = True
MESHES = True
QUOTE = {'"': "&quot;"}


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The robot description as text."""
    x, y, z = (f"{v:.17g}" for v in body.center_of_mass)
    inertia = " ".join(f'{n}="{v:.17g}"' for n, v in body.elements.items())
    shapes = "".join(
        f'    <{tag}>\n      <geometry><mesh filename="{escape(meshes[tag], QUOTE)}"/></geometry>\n    </{tag}>\n'
        for tag in ("visual", "collision")
        if tag in meshes
    )
    return (
        f'<?xml version="1.0"?>\n{xml_comment(body)}\n<robot name="{body.name}">\n'
        f'  <link name="{body.name}">\n    <inertial>\n      <origin xyz="{x} {y} {z}" rpy="0 0 0"/>\n'
        f'      <mass value="{body.mass:.17g}"/>\n      <inertia {inertia}/>\n    </inertial>\n'
        f"{shapes}  </link>\n</robot>\n"
    )
