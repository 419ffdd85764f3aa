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
BODY = tuple(q.name for q in PARAMETERS)
SEARCHED = False  # the balance of momentum finds it
OFF = 0.05
"""How far the centre of mass may lie from where the mesh has it, as in `solar_pressure_on_mesh`."""


def momentum_prior():
    """(4, 4): the parameters of unknowns that are independent."""
    import numpy as np

    return np.diag([1.0, OFF, OFF, OFF])


def measured(given):
    """The effect of a mesh whose `faces` are given (`massprops.dynamics.mesh_faces`), and the `orbit_normal`, inertial axes."""
    from massprops.dynamics.mesh_faces import faces_of, functions_of

    normal = tuple(float(v) for v in given["orbit_normal"])

    def wind(q, environment):
        x, y, z = cross(*normal, *environment.position)
        size = (x * x + y * y + z * z) ** 0.5
        return to_body(*q, x / size, y / size, z / size)

    return {"NEEDS": ("orbit",), **functions_of(faces_of(given), wind, kinds=1)}
