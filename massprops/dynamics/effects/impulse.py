"""A sudden knock: contact, a collision, a short thruster pulse."""

from massprops.effects import Parameter

NAME = "impulse"
SENTENCE = "A sudden knock at one moment changes rotation and velocity: a contact, a collision, a pulse."
FORMULA = "at time, momentum grows by kick and the velocity by velocity"
PARAMETERS = (
    Parameter("time", "s", 1.0, None, "time"),
    *(Parameter(f"kick_{a}", "rad s^-1", 1e-2, 100.0) for a in "xyz"),
    *(Parameter(f"velocity_{a}", "m s^-1", 1e-2, 100.0) for a in "xyz"),
)
NEEDS = ()


def jump(p):
    """Angular momentum over the mean moment, added at `time`, body axes."""
    return p[1], p[2], p[3]


def displacement(t, p):
    """Path of the centre of mass after its velocity changed, inertial axes."""
    since = (t - p[0]) * (t.real > p[0].real)
    return since * p[4], since * p[5], since * p[6]


MOMENTUM_UNKNOWNS = ("kick_x", "kick_y", "kick_z")


def momentum_columns(t, R, w, held):
    """A step of the momentum at `time`, in the body's axes of that moment."""
    at = held["time"]
    k = min(max(int(t.searchsorted(at)), 1), len(t) - 1)
    # the axes between two points of the path: those of the nearer one
    k = k if t[k] - at < at - t[k - 1] else k - 1
    return {"momentum": (t >= at)[:, None, None] * R[k]}


def momentum_scan(t, w):
    """Halfway between neighbouring measurements, where two stand on either side."""
    return [{"time": float(0.5 * (a + b))} for a, b in zip(t[1:-2], t[2:-1], strict=True)]


def starts(span, speed):
    """No knock, at moments spread over the record."""
    return [(span * (k + 0.5) / 16, 0, 0, 0, 0, 0, 0) for k in range(16)]
