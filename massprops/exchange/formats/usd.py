"""USD (Isaac Sim, Omniverse, Blender, usdview): one rigid body with `PhysicsMassAPI` and its mesh, as text.

`physics:diagonalInertia` is about the centre of mass along `physics:principalAxes`, a quaternion that turns principal axes
into the prim's (UsdPhysics: "Mass, center of mass, inertia").
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from massprops.dynamics.quaternion import from_rotation_matrix
from massprops.exchange.body import Body

NAME = "usd"
SUFFIX = ".usda"
NEEDS_METRES = True
MESHES = False


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The layer as text."""
    from massprops.exchange.collision import collision_mesh
    from massprops.mass.properties import principal_frame

    moments, axes = principal_frame(body.inertia)
    mesh = collision_mesh(body.mesh, 150_000)
    remarks = " ".join(body.remarks).replace("\\", "/").replace('"', "'")
    points = ", ".join(f"({x:.9g}, {y:.9g}, {z:.9g})" for x, y, z in np.asarray(mesh.vertices))
    faces = ", ".join(map(str, np.asarray(mesh.faces).ravel().tolist()))
    low, high = (", ".join(f"{v:.9g}" for v in end) for end in mesh.bounds)
    numbers = {
        "float physics:mass": f"{body.mass:.9g}",
        "point3f physics:centerOfMass": _tuple(body.center_of_mass),
        "float3 physics:diagonalInertia": _tuple(moments),
        "quatf physics:principalAxes": _tuple(from_rotation_matrix(axes)),
    }
    return (
        f'#usda 1.0\n(\n    defaultPrim = "{body.name}"\n    doc = "{remarks}"\n    metersPerUnit = 1\n    kilogramsPerUnit = 1\n'
        f'    upAxis = "Z"\n)\n\ndef Xform "{body.name}" (\n    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]\n'
        ")\n{\n" + "".join(f"    {key} = {value}\n" for key, value in numbers.items()) + '\n    def Mesh "surface" (\n'
        '        prepend apiSchemas = ["PhysicsCollisionAPI"]\n    )\n    {\n'
        f"        float3[] extent = [({low}), ({high})]\n"
        f"        int[] faceVertexCounts = [{', '.join(['3'] * len(mesh.faces))}]\n"
        f"        int[] faceVertexIndices = [{faces}]\n        point3f[] points = [{points}]\n"
        '        uniform token subdivisionScheme = "none"\n    }\n}\n'
    )


def _tuple(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:.9g}" for v in values) + ")"
