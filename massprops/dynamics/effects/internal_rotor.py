"""A wheel turns inside the body, at one speed or at a changing one."""

from massprops.effects import Parameter

NAME = "internal-rotor"
SENTENCE = "A wheel inside the body carries angular momentum of its own."
PARAMETERS = (
    *(Parameter(f"momentum_{a}", "rad s^-1", 1e-2, 1e5) for a in "xyz"),
    *(Parameter(f"shape_{k}", "1", 0.5, 50.0, form=1) for k in range(1, 5)),
    Parameter("span", "s", 1.0, None, "span"),
)
NEEDS = ()


def internal(t, z, p):
    """Momentum of the wheel against the body, over the mean moment: an axis fixed in the body times a history.

    `momentum` is the mean over `span`; its history is 1 + sum shape_k P_k over the record, P_k Legendre's polynomials,
    whose means are zero. A wheel at one speed has no shape.
    """
    x = 2.0 * t / p[7] - 1.0 if p[7].real > 0 else 0.0 * t
    g = 1.0 + sum(s * f for s, f in zip(p[3:7], legendre(x), strict=True))
    return p[0] * g, p[1] * g, p[2] * g


def legendre(x):
    """P_1 to P_4."""
    square = x * x
    return x, 1.5 * square - 0.5, x * (2.5 * square - 1.5), square * (4.375 * square - 3.75) + 0.375
