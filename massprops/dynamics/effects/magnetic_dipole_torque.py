"""A magnetic moment of the body turns in the field."""

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "magnetic-dipole-torque"
SENTENCE = "A magnetic moment fixed in the body is turned by the field around it."
FORMULA = "torque = dipole x B"
PARAMETERS = tuple(Parameter(f"dipole_{a}", "rad s^-2 T^-1", 1.0, 1e9) for a in "xyz")
NEEDS = ("magnetic field",)
BODY = ("dipole_x", "dipole_y", "dipole_z")


def torque(t, q, w, p, inertia, environment):
    """m x B, body axes."""
    return cross(p[0], p[1], p[2], *to_body(*q, *environment.field))
