"""The surroundings brake the rotation about each axis of the body by its own amount: a blade in air."""

from massprops.effects import Parameter

NAME = "drag-by-axis"
SENTENCE = "The air brakes the rotation about each axis of the body by its own amount."
FORMULA = "torque = -(damping_x w_x, damping_y w_y, damping_z w_z)"
PARAMETERS = tuple(Parameter(f"damping_{a}", "s^-1", 1e-2, 100.0, least=0.0) for a in "xyz")
NEEDS = ()
BODY = ("damping_x", "damping_y", "damping_z")
SEARCHED = False  # the balance of momentum finds it; the search over starts does not try it


def torque(t, q, w, p, inertia, environment):
    """Against the rate about each body axis, in proportion to it."""
    return -p[0] * w[0], -p[1] * w[1], -p[2] * w[2]
