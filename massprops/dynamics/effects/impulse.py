"""A knock: contact, a collision, a short thruster pulse."""

from massprops.effects import Parameter

NAME = "impulse"
SENTENCE = "A knock at one moment changes rotation and velocity: a contact, a collision, a pulse."
FORMULA = "at time, momentum grows by kick and the velocity by velocity"
PARAMETERS = (
    Parameter("time", "s", 1.0, None, "time"),
    *(Parameter(f"kick_{a}", "rad s^-1", 1e-2, 100.0) for a in "xyz"),
    *(Parameter(f"velocity_{a}", "m s^-1", 1e-2, 100.0) for a in "xyz"),
    Parameter("duration", "s", 1.0, None, "duration", least=0.0),
)
NEEDS = ()


def jump(p):
    """Angular momentum over the mean moment, added at `time`, body axes: all at once where it has no duration."""
    once = 1.0 * (p[7].real <= 0.0)
    return once * p[1], once * p[2], once * p[3]


def torque(t, q, w, p, inertia, environment):
    """The same momentum added evenly, body axes, from `time` on over `duration`."""
    since = t.real - p[0].real
    rate = 1.0 * (since > 0.0) * (since < p[7].real) / max(p[7].real, 1e-300)
    return rate * p[1], rate * p[2], rate * p[3]


def displacement(t, p):
    """Path of the centre of mass after its velocity changed, inertial axes."""
    middle = p[0] + 0.5 * p[7]
    since = (t - middle) * (t.real > middle.real)
    return since * p[4], since * p[5], since * p[6]


MOMENTUM_UNKNOWNS = ("kick_x", "kick_y", "kick_z")
MOMENTS = 60
CONTACTS = ((0, 1), (2, 2), (4, 4), (7, 7), (8, 1), (32, 1))
"""Durations tried, in measurements, and into how many parts with a kick each they fall: a contact need not push evenly."""


def momentum_columns(t, R, w, held):
    """What each part has added, evenly over its share of `duration` from `time` on, in the body's axes."""
    parts = int(held.get("parts", 1))
    length = held.get("duration", 0.0) / parts
    out = []
    for part in range(parts):
        begins = held["time"] + part * length
        k = min(max(int(t.searchsorted(begins + 0.5 * length)), 1), len(t) - 1)
        # shorter than a step of the path it is spread over one, so that it moves smoothly with its time
        short = max(t[k] - t[k - 1] - length, 0.0)
        share = ((t - begins + 0.5 * short) / (length + short)).clip(0.0, 1.0)
        added = 0.0 * R
        added[1:] = (0.5 * (share[1:] - share[:-1])[:, None, None] * (R[1:] + R[:-1])).cumsum(axis=0)
        out += [added[:, :, j] for j in range(3)]
    return {"momentum": out}


def momentum_scan(t, w):
    """Halfway between neighbouring measurements, where two stand on either side; of many, as many as MOMENTS."""
    every = [{"time": float(0.5 * (a + b))} for a, b in zip(t[1:-2], t[2:-1], strict=True)]
    return every[:: max(1, len(every) // MOMENTS)]


def momentum_variants(held, gap):
    """Longer ones about the same middle; gap: between measurements [s]."""
    return [{"time": held["time"] - 0.5 * n * gap, "duration": n * gap, "parts": p} for n, p in CONTACTS]


def momentum_alike(held):
    """One even push in place of parts that differ."""
    return [held | {"parts": 1}] if held.get("parts", 1) > 1 else []


def momentum_steps(held, gap):
    """By what time and duration are moved to find their best."""
    return {"time": 0.3 * gap} | ({"duration": 0.3 * gap} if held.get("duration", 0.0) > 0 else {})


def starts(span, speed):
    """No knock, at moments spread over the record."""
    return [(span * (k + 0.5) / 16, 0, 0, 0, 0, 0, 0, 0) for k in range(16)]
