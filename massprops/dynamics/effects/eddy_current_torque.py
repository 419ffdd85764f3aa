"""Currents that a magnetic field induces in a turning conductor brake it."""

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "eddy-current-torque"
SENTENCE = "Eddy currents in the conducting body brake its rotation across the magnetic field."
FORMULA = "torque = conductance (w x B) x B"
PARAMETERS = (Parameter("conductance", "s^-1 T^-2", 1e6, 1e14, least=0.0),)
NEEDS = ("magnetic field",)
BODY = ("conductance",)


def torque(t, q, w, p, inertia, environment):
    """conductance (w x B) x B (Praly et al. 2012, isotropic magnetic tensor)."""
    bx, by, bz = to_body(*q, *environment.field)
    tx, ty, tz = cross(*cross(w[0], w[1], w[2], bx, by, bz), bx, by, bz)
    return p[0] * tx, p[0] * ty, p[0] * tz
