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
NOTE = (
    "Where rotor0 holds the wheel's rate there are no shapes: the momentum follows the rate and is that at its largest, along each "
    "axis, or along the wheel's axis where it is known. Several records share that momentum over that rate, the wheel's moment of inertia."
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


def measured(given):
    """The effect of a wheel whose rate was measured, by `times_s` since the first timestamp and `rate_rad_s`, and of known `axis`
    or none. The momentum has one unknown for each axis that it may lie along."""
    import numpy as np

    times, rates = np.asarray(given["times_s"], float), np.asarray(given["rate_rad_s"], float)
    largest = float(np.abs(rates).max(initial=0.0))
    if times.ndim != 1 or times.shape != rates.shape or len(times) < 2 or not (np.diff(times) > 0).all():
        raise ValueError("must have times_s that rise, two at least, and a rate_rad_s for each")
    if not (np.isfinite(times).all() and np.isfinite(rates).all() and largest > 0.0):
        raise ValueError("must have finite rates that are not all zero")
    axis = given.get("axis")
    ways = np.eye(3) if axis is None else np.asarray(axis, float).reshape(1, 3) / np.linalg.norm(axis)
    names = tuple(q.name for q in PARAMETERS[:3]) if axis is None else ("momentum",)

    share, along = rates / largest, ways.tolist()
    of_body = {n: n.replace("momentum", "moment") for n in names}

    def internal(t, z, p):
        h = np.interp(np.real(t), times, share)
        return (h * p[0], h * p[1], h * p[2]) if axis is None else tuple(h * (p[0] * a) for a in along[0])

    def momentum_columns(t, R, w, held):
        return {"internal": np.interp(t, times, share)[:, None, None] * ways.T}

    return {
        "FORMULA": "momentum inside = momentum rate(t) / largest rate",
        "PARAMETERS": tuple(Parameter(n, "rad s^-1", 1e-2, 1e5) for n in names),
        "MOMENTUM_UNKNOWNS": names,
        "BODY": names,
        "BODY_NUMBERS": {n: (body_name, largest) for n, body_name in of_body.items()},
        "internal": internal,
        "momentum_columns": momentum_columns,
        "corners": None,
        "penalty": None,
        "longer_starts": None,
    }
