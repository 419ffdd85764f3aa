"""The pull of the planet on the near side of the body is stronger than on the far side."""

from massprops.dynamics.kernels import cross, symmetric_times, to_body
from massprops.effects import Parameter

NAME = "gravity-gradient-torque"
SENTENCE = "The planet pulls the near side of the body harder than the far side and turns it."
FORMULA = "torque = strength 3 mu / r^5 r x (I r)"
PARAMETERS = (Parameter("strength", "1", 1.0, 3.0, least=0.3),)
NEEDS = ("orbit",)
BODY = ("strength",)


def torque(t, q, w, p, inertia, environment):
    """3 mu / r^5 r x I r (volpe2017); `strength` is 1 for the orbit as given."""
    x, y, z = environment.position
    square = x * x + y * y + z * z
    factor = 3.0 * environment.mu / (square * square**0.5)
    x, y, z = to_body(*q, x, y, z)
    ix, iy, iz = symmetric_times(*inertia, x, y, z)
    tx, ty, tz = cross(x, y, z, ix, iy, iz)
    factor = factor * p[0] / square
    return factor * tx, factor * ty, factor * tz
