"""The body changes its mass distribution at one moment: a boom deploys, a part lets go, fuel moves."""

from massprops.effects import Parameter

NAME = "inertia-change"
SENTENCE = "The mass distribution changes at one moment: something deploys, moves inside or lets go."
FORMULA = "at time, I grows by inertia, the centre of mass moves by centre, the body turns by swing"
PARAMETERS = (
    Parameter("time", "s", 1.0, None, "time"),
    *(Parameter(f"inertia_{n}", "1", 0.05, 3.0) for n in ("xx", "yy", "zz", "xy", "xz", "yz")),
    *(Parameter(f"centre_{a}", "m", 0.05, 10.0) for a in "xyz"),
    *(Parameter(f"swing_{a}", "rad", 0.02, 1.0, form=1) for a in "xyz"),
)
NEEDS = ()


def inertia(t, six, p):
    """After `time` the inertia is larger by the six parameters, over the mean moment before."""
    after = 1.0 * (t.real > p[0].real)
    a, b, c, d, e, f = six
    return (
        a + after * p[1],
        b + after * p[2],
        c + after * p[3],
        d + after * p[4],
        e + after * p[5],
        f + after * p[6],
    )


def shift(t, p):
    """The centre of mass moves by `centre` in body axes, so feature points move against it."""
    after = 1.0 * (t.real > p[0].real)
    return -after * p[7], -after * p[8], -after * p[9]


def swing(p):
    """Turn of the body, its axes, while the mass travels: what moves beside the centre of mass is answered by the rest."""
    return p[10], p[11], p[12]


def penalty(p):
    """A moment about an axis that the body hardly turns about does not show: its change stays below the mean moment."""
    return p[1:7]


MOMENTUM_UNKNOWNS = (
    *(f"inertia_{n}" for n in ("xx", "yy", "zz", "xy", "xz", "yz")),
    *(f"swing_{a}" for a in "xyz"),
)


def momentum_columns(t, R, w, held):
    """What the change of inertia carries after `time`, and the body's swing at that time, done within a step or two."""
    nine = [0, 0, 0, 0, 0, 0, 0, 0, 0]
    inside, swing = 0.0 * R[:, :, nine], 0.0 * R[:, :, nine]
    for k, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        inside[:, i, k] += w[:, j]
        if i != j:
            inside[:, j, k] += w[:, i]
    at = min(max(int(t.searchsorted(held["time"])), 2), len(t) - 2)
    share = (held["time"] - t[at - 1]) / (t[at] - t[at - 1])
    for k, part in ((at - 1, 1.0 - share), (at, share)):
        for axis in range(3):
            swing[k, axis, 6 + axis] = part * 2.0 / (t[k + 1] - t[k - 1])
    return {"internal": (t > held["time"])[:, None, None] * inside, "rate": swing}


def momentum_scan(t, w):
    """A twentieth of the record apart."""
    return [{"time": float(t[0] + (t[-1] - t[0]) * k / 20)} for k in range(2, 19)]


def momentum_steps(held, gap):
    """Some measurements: the scan is coarse."""
    return {"time": 5.0 * gap}


def starts(span, speed):
    """No change, at moments spread over the record."""
    return [(span * (k + 0.5) / 10, *[0] * 12) for k in range(10)]
