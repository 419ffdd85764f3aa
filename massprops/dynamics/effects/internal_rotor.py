"""A wheel turns inside the body, at one speed or at a changing one."""

from massprops.effects import Parameter

SHAPES = 9
NAME = "internal-rotor"
SENTENCE = "A wheel inside the body carries angular momentum of its own."
FORMULA = "momentum inside = momentum (1 + sum_k shape_k (hat_k(t / span) - mean of hat_k))"
PARAMETERS = (
    *(Parameter(f"momentum_{a}", "rad s^-1", 1e-2, 1e5) for a in "xyz"),
    *(Parameter(f"shape_{k}", "1", 0.5, 50.0, form=1) for k in range(1, SHAPES + 1)),
    Parameter("span", "s", 1.0, None, "span"),
)
NEEDS = ()


def internal(t, z, p):
    """Momentum of the wheel against the body, over the mean moment: an axis fixed in the body times a history.

    `momentum` is the mean over `span`; the history is 1 + sum shape_k (hat_k - its mean), hats linear between SHAPES
    even moments from start to end. A wheel at one speed has no shape.
    """
    span = p[3 + SHAPES]
    x = t / span * (SHAPES - 1) if span > 0 else 0.0 * t
    g = 1.0
    for k in range(SHAPES):
        if p[3 + k] != 0.0:
            away = abs(x - k)
            hat = (1.0 - away) * (away < 1.0)
            mean = (0.5 if k in (0, SHAPES - 1) else 1.0) / (SHAPES - 1)
            g = g + p[3 + k] * (hat - mean)
    return p[0] * g, p[1] * g, p[2] * g


def corners(p):
    """Moments at which the history has its corners."""
    return [p[3 + SHAPES] * k / (SHAPES - 1) for k in range(1, SHAPES - 1)]


def penalty(p):
    """Neighbouring values of the history are alike within their mean: what no data show stays as it was."""
    return [p[3 + k + 1] - p[3 + k] for k in range(SHAPES - 1)]


MOMENTUM_UNKNOWNS = ("momentum_x", "momentum_y", "momentum_z")


def momentum_columns(t, R, w, held):
    """A wheel at one speed: its momentum along each body axis. One of any history is solved for by its knots."""
    out = 0.0 * R
    for k in range(3):
        out[:, k, k] = 1.0
    return {"internal": out}


def longer_starts(span, speed):
    """A wheel that spins up from rest or slows down to it, about each of 13 axes, either way."""
    out = []
    for x, y, z in AXES:
        length = (x * x + y * y + z * z) ** 0.5
        for size in (0.1 * speed, -0.1 * speed):
            for ramp in (1.0, -1.0):
                shape = [ramp * (2.0 * k / (SHAPES - 1) - 1.0) for k in range(SHAPES)]
                out.append((size * x / length, size * y / length, size * z / length, *shape, span))
    return out


AXES = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)]
