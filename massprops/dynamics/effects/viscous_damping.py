"""A torque against the rotation, in proportion to it."""

from massprops.effects import Parameter

NAME = "viscous-damping"
SENTENCE = "The surroundings brake the rotation in proportion to its rate: a gas, a fluid, a bearing."
FORMULA = "torque = -damping w"
PARAMETERS = (Parameter("damping", "s^-1", 1e-3, 10.0, least=0.0),)
NEEDS = ()
BODY = ("damping",)


def torque(t, q, w, p, inertia, environment):
    """-damping times the angular velocity."""
    return -p[0] * w[0], -p[0] * w[1], -p[0] * w[2]
