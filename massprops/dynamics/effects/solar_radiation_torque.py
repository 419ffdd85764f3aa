"""Sunlight pushes at a point other than the centre of mass."""

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "solar-radiation-torque"
SENTENCE = "Sunlight pushes on the body at a centre of pressure that is not its centre of mass."
FORMULA = "torque = pressure x (-s), s toward the Sun"
PARAMETERS = tuple(Parameter(f"pressure_{a}", "rad s^-2", 1e-4, 1.0) for a in "xyz")
NEEDS = ("sun direction",)
BODY = ("pressure_x", "pressure_y", "pressure_z")


def torque(t, q, w, p, inertia, environment):
    """p x (-s): p is force times the centre of pressure, body axes; s points to the Sun."""
    x, y, z = to_body(*q, *environment.sun)
    return cross(p[0], p[1], p[2], -x, -y, -z)
