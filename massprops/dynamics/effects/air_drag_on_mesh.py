"""Thin air in a low orbit pushes on the faces of the body's own mesh that look into the wind."""

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "air-drag-on-mesh"
SENTENCE = "The thin air of a low orbit pushes on the windward faces of the body's mesh."
FORMULA = "force on a windward face = -drag area (n.v) v, v along the flight, n the normal"
NOTE = (
    "`drag` is the pressure on the area of the whole surface, times the root of that area. Those with an axis are minus the same times the "
    "place of the centre of mass from where the mesh has it, over that root. The wind is that of a nearly round orbit."
)
PARAMETERS = (
    Parameter("drag", "rad s^-2", 1e-5, 1.0, least=0.0),
    *(Parameter(f"drag_{a}", "rad s^-2", 1e-6, 1.0) for a in "xyz"),
)
NEEDS = ("orbit", "mesh")
SEARCHED = False  # the balance of momentum finds it
OFF = 0.05
"""How far the centre of mass may lie from where the mesh has it, as in `solar_pressure_on_mesh`."""


def momentum_prior():
    """(4, 4): the parameters of unknowns that are independent."""
    import numpy as np

    return np.diag([1.0, OFF, OFF, OFF])


def measured(given):
    """The effect of a mesh whose `faces` are given (`massprops.dynamics.mesh_faces`), and the `orbit_normal`, inertial axes."""
    from massprops.dynamics.mesh_faces import faces_of, unit_torques_of

    faces, normal = faces_of(given), tuple(float(v) for v in given["orbit_normal"])

    def unit_torques(t, q, w, environment):
        x, y, z = cross(*normal, *environment.position)
        size = (x * x + y * y + z * z) ** 0.5
        return unit_torques_of(faces, to_body(*q, x / size, y / size, z / size), kinds=1)

    def torque(t, q, w, p, inertia, environment):
        units = unit_torques(t, q, w, environment)
        return tuple(sum(v * u[i] for v, u in zip(p, units)) for i in range(3))

    return {"NEEDS": ("orbit",), "torque": torque, "unit_torques": unit_torques, "LARGEST_TURN": 0.2}
