"""The mass is not spread evenly through the shape that is seen."""

from massprops.effects import Parameter

NAME = "nonuniform-density"
SENTENCE = "The mass is not spread evenly: the inertia differs from that of the shape at constant density."
FORMULA = "I = I assumed + inertia, without trace"
PARAMETERS = tuple(Parameter(f"inertia_{n}", "1", 0.05, 3.0) for n in ("xx_yy", "zz", "xy", "xz", "yz"))
NEEDS = ("assumed inertia",)


def inertia(t, six, p):
    """The assumed inertia with a difference of zero trace, over the mean moment."""
    a, b, c, d, e, f = six
    return a + p[0] - 0.5 * p[1], b - p[0] - 0.5 * p[1], c + p[1], d + p[2], e + p[3], f + p[4]
