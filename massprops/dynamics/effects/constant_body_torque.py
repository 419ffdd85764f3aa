"""A torque that is constant in the body, such as a leaking thruster."""

from massprops.effects import Parameter

NAME = "constant-body-torque"
SENTENCE = "A torque fixed in the body acts all the time: a leak, a stuck thruster, outgassing."
FORMULA = "torque = (torque_x, torque_y, torque_z), body axes"
PARAMETERS = tuple(Parameter(f"torque_{a}", "rad s^-2", 1e-4, 1.0) for a in "xyz")
NEEDS = ()


def torque(t, q, w, p, inertia, environment):
    """The same in body axes at all times."""
    return p[0], p[1], p[2]
