"""A sudden knock: contact, a collision, a short thruster pulse."""

from massprops.effects import Parameter

NAME = "impulse"
SENTENCE = "A sudden knock at one moment changes rotation and velocity: a contact, a collision, a pulse."
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


def starts(span, speed):
    """No knock, at moments spread over the record."""
    return [(span * (k + 0.5) / 16, 0, 0, 0, 0, 0, 0) for k in range(16)]
