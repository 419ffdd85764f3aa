"""A mass moves along a line against a spring and a damper: sloshing fuel, a hinged panel, a loose part."""

import numpy as np

from massprops.dynamics.kernels import cross
from massprops.effects import Parameter

NAME = "spring-mass-damper"
SENTENCE = "Something swings on a spring: fuel sloshes, a hinged panel or a loose mass moves against the body."
FORMULA = (
    "r = arm + s along;  s'' + damping s' + frequency^2 s = -along . (acceleration of the body's point r);  "
    "extra momentum = r x (w x r + s' along) - arm x (w x arm)"
)
NOTE = (
    "A mass rests at `arm` from the centre of mass and moves by s along the direction `along`; s is `displacement` and s' is "
    "`velocity` at the first timestamp. `frequency` and `damping` are those of the mass on its spring while the body holds still. "
    "Lengths are without unit, since motion alone shows none: they are multiplied by the square root of the mass over the "
    "body's mean moment of inertia."
)
PARAMETERS = (
    *(Parameter(f"arm_{a}", "1", 0.1, 2.0) for a in "xyz"),
    *(Parameter(f"along_{a}", "1", 0.6, 10.0) for a in "xyz"),
    Parameter("frequency", "rad s^-1", 0.1, 1e3, least=0.0),
    Parameter("damping", "s^-1", 0.01, 1e3, least=0.0),
    Parameter("displacement", "1", 0.01, 1.0),
    Parameter("velocity", "s^-1", 0.001, 10.0),
)
"""Of a body that is not much heavier, the mass in `NOTE` is the reduced one."""
NEEDS = ()
BODY = (*(f"{part}_{a}" for part in ("arm", "along") for a in "xyz"), "frequency", "damping")
STATES = 3  # displacement, its momentum, none
SEARCHED = False  # the balance of momentum finds it


def internal_start(w, p):
    """Displacement, and the momentum that belongs to it: s' + (arm x along) . w."""
    a, b, c = cross(p[0], p[1], p[2], p[3], p[4], p[5])
    length = (p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + 1e-300) ** 0.5
    return p[8], p[9] + (a * w[0] + b * w[1] + c * w[2]) / length, 0.0 * p[8]


def internal(t, z, p):
    """Angular momentum beside that of `moving_inertia`."""
    a, b, c = cross(p[0], p[1], p[2], p[3], p[4], p[5])
    scale = z[1] / (p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + 1e-300) ** 0.5
    return scale * a, scale * b, scale * c


def moving_inertia(six, z, p):
    """The body's inertia with the mass where it is, less what the mass's own speed takes of it."""
    length = (p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + 1e-300) ** 0.5
    x, y, v = p[3] / length, p[4] / length, p[5] / length
    a, b, c = cross(p[0], p[1], p[2], x, y, v)
    s = z[0]
    dot = 2.0 * s * (p[0] * x + p[1] * y + p[2] * v) + s * s
    return (
        six[0] + dot - 2.0 * s * p[0] * x - s * s * x * x - a * a,
        six[1] + dot - 2.0 * s * p[1] * y - s * s * y * y - b * b,
        six[2] + dot - 2.0 * s * p[2] * v - s * s * v * v - c * c,
        six[3] - s * (p[0] * y + p[1] * x) - s * s * x * y - a * b,
        six[4] - s * (p[0] * v + p[2] * x) - s * s * x * v - a * c,
        six[5] - s * (p[1] * v + p[2] * y) - s * s * y * v - b * c,
    )


def internal_rate(t, w, z, p):
    """Lagrange's equation of the displacement (a mass on a rail of a turning body)."""
    length = (p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + 1e-300) ** 0.5
    x, y, v = p[3] / length, p[4] / length, p[5] / length
    a, b, c = cross(p[0], p[1], p[2], x, y, v)
    speed = z[1] - (a * w[0] + b * w[1] + c * w[2])
    along = w[0] * x + w[1] * y + w[2] * v
    arm = w[0] * p[0] + w[1] * p[1] + w[2] * p[2]
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    # of the kinetic energy by the displacement: what is called centrifugal
    outward = square * (p[0] * x + p[1] * y + p[2] * v) - along * arm + z[0] * (square - along * along)
    return speed, outward - p[6] * p[6] * z[0] - p[7] * speed, 0.0 * z[0]


def internal_pace(p):
    """The spring may be several times as fast as the body turns; of a damper faster still, steps need only be stable."""
    return max(p[6], 0.4 * p[7])


MOMENTUM_UNKNOWNS = (
    "arm_x", "arm_y", "arm_z", "displacement", "velocity", "along_x", "along_y", "along_z", "frequency", "damping",
)  # fmt: skip
MOMENTUM_VALLEY = "frequency"
"""A stiffer spring with a mass farther out and more damping moves nearly as a softer one: the likelihood has a long curved valley, often
with several ends."""
SMALL = 1e-5
LARGEST_MOVE = 0.5
"""Of direction [rad] and of the logarithms of frequency and damping, in a pass."""


def momentum_columns(t, R, w, held):
    """The momentum inside about the values in `held`.

    It is quadratic in g = (arm, displacement, velocity) together, so its linearisation about g0 is
    J (g - g0 / 2): the first five unknowns are g - g0 / 2. Those of direction, frequency and damping are steps, as large
    as g0.
    """
    from massprops.dynamics.spring_kernel import momentum_inside

    now = _values(held)
    size = _size(now)
    tried = [now]
    for k in range(10):
        step = np.zeros(10)
        step[k] = SMALL * (size if k < 5 else 1.0)
        tried.append(_moved(now, step))
    h = momentum_inside(t, w, np.array(tried))
    columns = (h[:, 1:] - h[:, :1]) / SMALL / size
    return {"internal": np.moveaxis(columns, 1, 2)}


def momentum_moved(held, unknowns):
    """The parameters that the unknowns stand for."""
    now = _values(held)
    step = np.asarray(unknowns).copy()
    step[:5] -= 0.5 * now[:5]
    step[5:] = LARGEST_MOVE * np.tanh(step[5:] / _size(now) / LARGEST_MOVE)
    return dict(zip(MOMENTUM_UNKNOWNS, _moved(now, step).tolist(), strict=True))


def momentum_alike(held):
    """Arm and way in each other's place: the drive of the swing and the lever of its momentum are then the same but for a sign, so that
    each has a likeliest fit of its own. The displacement may begin on either side."""
    now = _values(held)
    arm, u, size = now[:3], now[5:8] / np.sqrt(np.sum(now[5:8] ** 2)), _size(now)
    places = [f"{part}_{a}" for part in ("arm", "along") for a in "xyz"]
    turned = held | dict(zip(places, [*(size * u).tolist(), *(arm / size).tolist()], strict=True))
    return [turned, turned | {k: -held[k] for k in ("displacement", "velocity")}]


def momentum_here(held):
    """The unknowns that stand for the parameters in `held`."""
    return np.concatenate([0.5 * _values(held)[:5], np.zeros(5)])


LIKELY_ARM = 0.2
"""Prior of the arm: of a point mass that far out, a twenty-fifth of the mean moment of inertia."""
LIKELY_START = 0.05
"""1-sigma of where the mass is when the record begins, and of its speed over the frequency."""


def momentum_sd(held):
    """Prior standard deviations of the unknowns: without one, a mass that carries nearly all of the inertia moves as it likes."""
    return np.array([LIKELY_ARM] * 3 + [LIKELY_START, LIKELY_START * held["frequency"]] + [_size(_values(held))] * 5)


MOMENTUM_OPEN = ("damping",)


def momentum_log_prior(values):
    """The arm's size may have any order of magnitude, while a normal law of its three components (`momentum_sd`) has it large: a stiff
    spring with a long arm moves nearly as a soft one with a short arm, and this law alone would decide between them."""
    return -3.0 * float(np.log(_size(values)))


LEAST_LEFT = 0.002
"""Of the sum of second moments of mass, what is left without the mass along any direction (`criteria.LEAST_SHARE`)."""


def can_be(inertia, w, values):
    """Whether a body of this inertia (3, 3) holds the mass, and the spring holds it at rates w (n, 3): a mass that flies out is no
    swing."""
    arm, u = values[:3], values[5:8] / np.sqrt(np.sum(values[5:8] ** 2))
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia - np.outer(arm, arm)
    softer = float(np.mean(np.sum(np.cross(w, u) ** 2, axis=1)))
    held = float(values[8]) > 0.0 and float(values[8]) ** 2 > softer
    return held and bool(np.linalg.eigvalsh(second)[0] > LEAST_LEFT * 0.5 * np.trace(inertia))


FREQUENCIES = (0.7, 1.2, 2.0, 3.2, 5.0, 8.0)
"""Over the body's rate."""
DAMPINGS = (0.06, 0.3, 1.0)
"""Over the frequency."""
STARTS = 144


def momentum_scan(t, w):
    """Masses to begin with."""
    return _masses(t, w, 0)


def momentum_scan_again(t, w):
    """Others, where the first lead to nothing: those near the one there is may all have missed it."""
    return _masses(t, w, 1)


def _masses(t, w, draw):
    """Masses at random places on random ways, two at a time of each frequency that the times show and of each damping: a weak swing has many likeliest fits.
    One start of a single mass for each of many is cheaper than what leads from all masses together to the nearest single one."""
    rng = np.random.default_rng(draw)
    speed = max(float(((w * w).sum(axis=1) ** 0.5).mean()), 1e-12)
    fastest = 1.5 / float(np.median(np.diff(t)))
    used = [f * speed for f in FREQUENCIES if f * speed < fastest] or [FREQUENCIES[0] * speed]
    out = []
    for k in range(STARTS):
        arm, way = (x / np.sqrt(np.sum(x**2)) for x in rng.standard_normal((2, 3)))
        frequency, damping = used[k // 2 % len(used)], DAMPINGS[k // 2 // len(used) % len(DAMPINGS)]
        values = [*(LIKELY_ARM * arm).tolist(), 0.0, 0.0, *way.tolist(), frequency, damping * frequency]
        out.append(dict(zip(MOMENTUM_UNKNOWNS, values, strict=True)))
    return out


def _values(held):
    return np.array([held[name] for name in MOMENTUM_UNKNOWNS])


def _size(now):
    return max(float(np.sqrt(np.sum(now[:3] ** 2))), 1e-6)


def _moved(now, step):
    """(10,) after a step of arm, displacement, velocity and direction, and of the logarithms of frequency and damping."""
    out = now.copy()
    out[:5] += step[:5]
    u = now[5:8] / np.sqrt(np.sum(now[5:8] ** 2))
    u = u + step[5:8] - u * (u @ step[5:8])
    out[5:8] = u / np.sqrt(np.sum(u**2))
    out[8:] *= np.exp(step[8:])
    return out
