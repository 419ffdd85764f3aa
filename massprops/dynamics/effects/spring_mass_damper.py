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


MOMENTUM_UNKNOWNS = (
    "arm_x", "arm_y", "arm_z", "displacement", "velocity", "along_x", "along_y", "along_z", "frequency", "damping",
)  # fmt: skip
SMALL = 1e-5
LARGEST_MOVE = 0.5
"""Of direction [rad] and of the logarithms of frequency and damping, in a pass."""


def momentum_columns(t, R, w, held):
    """The momentum inside about the values in `held`, or for frequency and damping alone about none.

    The momentum is quadratic in g = (arm, displacement, velocity) together, so its linearisation about g0 is
    J (g - g0 / 2): the first five unknowns are g - g0 / 2. Those of direction, frequency and damping are steps, as large
    as g0. Without an arm it is linear in products of arm and way (`_any_way`).
    """
    if "arm_x" not in held:
        return {"internal": _any_way(t, w, held["frequency"], held["damping"])}
    now = _values(held)
    size = _size(now)
    tried = [now]
    for k in range(10):
        step = np.zeros(10)
        step[k] = SMALL * (size if k < 5 else 1.0)
        tried.append(_moved(now, step))
    h = _momentum(t, w, np.array(tried))
    columns = (h[:, 1:] - h[:, :1]) / SMALL / size
    return {"internal": np.moveaxis(columns, 1, 2)}


def momentum_moved(held, unknowns):
    """The parameters that the unknowns stand for."""
    if "arm_x" not in held:
        found = _of_products(np.asarray(unknowns))
        u = np.array([found[f"along_{a}"] for a in "xyz"])
        spin = np.array([[held[f"spin_{a}{b}"] for b in "xyz"] for a in "xyz"])
        # turning softens the spring, which the products leave out
        stiff = held["frequency"] ** 2 + np.trace(spin) - u @ spin @ u
        return found | {"frequency": float(np.sqrt(stiff)), "damping": held["damping"]}
    now = _values(held)
    step = np.asarray(unknowns).copy()
    step[:5] -= 0.5 * now[:5]
    step[5:] = LARGEST_MOVE * np.tanh(step[5:] / _size(now) / LARGEST_MOVE)
    return dict(zip(MOMENTUM_UNKNOWNS, _moved(now, step).tolist(), strict=True))


def momentum_alike(held):
    """Arm and way in each other's place: the drive of the swing and the lever of its momentum are then the same but for a sign, so that
    each has a likeliest fit of its own. The displacement may begin on either side."""
    if "arm_x" not in held:
        return []
    now = _values(held)
    arm, u, size = now[:3], now[5:8] / np.sqrt(np.sum(now[5:8] ** 2)), _size(now)
    places = [f"{part}_{a}" for part in ("arm", "along") for a in "xyz"]
    turned = held | dict(zip(places, [*(size * u).tolist(), *(arm / size).tolist()], strict=True))
    return [turned, turned | {k: -held[k] for k in ("displacement", "velocity")}]


def momentum_here(held):
    """The unknowns that stand for the parameters in `held`; None without an arm, where products are unknown."""
    return np.concatenate([0.5 * _values(held)[:5], np.zeros(5)]) if "arm_x" in held else None


LIKELY_ARM = 0.2
"""Prior of the arm: of a point mass that far out, a twenty-fifth of the mean moment of inertia."""
LIKELY_START = 0.05


def momentum_sd(held):
    """Prior standard deviations of the unknowns: without one, a mass that carries nearly all of the inertia moves as it likes."""
    if "arm_x" not in held:
        return np.array(
            [0.5 * LIKELY_ARM**2] * 45 + [LIKELY_ARM * LIKELY_START, LIKELY_ARM * LIKELY_START * held["frequency"]] * 9
        )
    return np.array([LIKELY_ARM] * 3 + [LIKELY_START, LIKELY_START * held["frequency"]] + [_size(_values(held))] * 5)


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


FREQUENCIES = tuple(0.5 * 1.24**k for k in range(15))
"""As close as a swing with a damping of a fifth is wide: with a factor of 1.45 a panel between two of them was missed."""
DAMPINGS = (0.03, 0.2, 1.0)


def momentum_scan(t, w):
    """Frequencies from half the body's rate to ten times it, as far as the times show them, dampings over them, and the mean
    square of the rate."""
    speed = float(((w * w).sum(axis=1) ** 0.5).mean())
    fastest = 1.5 / float(np.median(np.diff(t)))
    found = [k * max(speed, 1e-12) for k in FREQUENCIES]
    spin = (w.T @ w / len(w)).tolist()
    mean = {f"spin_{a}{b}": spin[i][j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")}
    used = [f for f in found if f < fastest] or found[:1]
    return [{"frequency": f, "damping": d * f, **mean} for f in used for d in DAMPINGS]


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


def _momentum(t, w, values):
    """(n, m, 3) inside, for m sets of parameters (m, 10)."""
    arm, start, u = values[:, :3], values[:, 3:5], values[:, 5:8]
    lever = np.cross(arm, u)
    s, speed = _oscillators(
        t, w, lever, _outward(w, arm[:, :, None] * u[:, None, :]), np.sum(np.cross(w[:, None], u) ** 2, axis=2),
        values[:, 8:], start,
    )  # fmt: skip
    at = arm + s[:, :, None] * u
    # (arm + s u) x (w x (arm + s u)) - arm x (w x arm) + s' arm x u
    return _carried(at, w[:, None]) - _carried(np.broadcast_to(arm, at.shape), w[:, None]) + speed[:, :, None] * lever


def _carried(r, w):
    """Angular momentum r x (w x r) of a unit mass at r."""
    return w * np.sum(r * r, axis=-1, keepdims=True) - r * np.sum(r * w, axis=-1, keepdims=True)


def _outward(w, S):
    """(n, m) what is called centrifugal along the way, at rest; S (m, 3, 3) arm times way."""
    square = np.sum(w * w, axis=1)
    return square[:, None] * np.trace(S, axis1=1, axis2=2) - np.einsum("ni,mij,nj->nm", w, S, w)


def _oscillators(t, w, lever, outward, softer, spring, start):
    """(n, m) displacement and speed of m oscillators, driven by the body's motion.

    Args:
        lever: (m, 3); outward, softer: (n, m) centrifugal drive and loss of stiffness; spring: (m, 2) frequency, damping; these and
        `softer` may be one of all. start: (m, 2) displacement, speed.
    """
    from massprops.dynamics.linear_recurrence import recurrence

    m, step = len(lever), np.diff(t)
    frequency, damping = spring.T
    turning = w @ lever.T
    drive = np.stack([-turning, damping * turning + outward], axis=2)
    middle = 0.5 * (drive[1:] + drive[:-1])
    stiff = frequency**2 - 0.5 * (softer[1:] + softer[:-1])
    half, whole = _transition(0.5 * step, stiff, damping), _transition(step, stiff, damping)
    added = _times(whole, drive[:-1]) + 4.0 * _times(half, middle) + drive[1:]
    added *= (step / 6.0)[:, None, None]
    whole = np.ascontiguousarray(np.broadcast_to(whole, (len(step), m, 2, 2)))
    y = recurrence(whole, added, start + np.stack([np.zeros(m), turning[0]], axis=1))
    return y[:, :, 0], y[:, :, 1] - turning


def _times(M, v):
    """(n, m, 2) products of matrices and vectors of two: one by one they take ten times as long."""
    return M[..., 0] * v[..., :1] + M[..., 1] * v[..., 1:]


def _transition(step, stiff, damping):
    """(n, m, 2, 2) exponential of [[0, 1], [-stiff, -damping]] over steps (n,)."""
    n, m = stiff.shape
    root = np.sqrt(0.25 * np.broadcast_to(damping, (n, m)) ** 2 - stiff + 0j)
    root = np.where(np.abs(root) < 1e-9, 1e-9, root)
    x = root * step[:, None]
    shrunk = np.exp(-0.5 * damping * step[:, None])
    even, odd = (np.cosh(x) * shrunk).real, (np.sinh(x) / root * shrunk).real
    out = np.empty((n, m, 2, 2))
    out[..., 0, 0] = even + 0.5 * damping * odd
    out[..., 0, 1] = odd
    out[..., 1, 0] = -stiff * odd
    out[..., 1, 1] = even - 0.5 * damping * odd
    return out


PAIRS = [(a, b) for a in range(9) for b in range(a, 9)]
"""Products of two elements of S, the arm times the way: 45."""
EVERY = np.eye(9).reshape(9, 3, 3)
LEVERS = np.array([[S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]] for S in EVERY])


def _any_way(t, w, frequency, damping):
    """Columns (n, 3, 63) of products of two of S, and of one of S with a displacement and a speed at the start, for
    small displacements: the drive is linear in S and the answer to a displacement is, too."""
    from massprops.dynamics.linear_recurrence import in_pairs

    drive = np.concatenate([_outward(w, EVERY), np.zeros((len(t), 2))], axis=1)
    lever = np.concatenate([LEVERS, np.zeros((2, 3))])
    start = np.concatenate([np.zeros((9, 2)), np.eye(2)])
    s, speed = _oscillators(t, w, lever, drive, np.zeros((len(t), 1)), np.array([[frequency, damping]]), start)
    return in_pairs(np.ascontiguousarray(_grown(w)), LEVERS, np.ascontiguousarray(s), speed)


def _grown(w):
    """(n, 9, 3) momentum of a unit displacement at rest, for each element of S."""
    return 2.0 * np.einsum("aii->a", EVERY)[:, None] * w[:, None] - np.einsum(
        "aij,nj->nai", EVERY + EVERY.swapaxes(1, 2), w
    )


def _of_products(unknowns):
    """The nearest single mass on a single way to what was found of the products."""
    P = np.zeros((9, 9))
    for value, (a, b) in zip(unknowns, PAIRS, strict=False):
        P[a, b] = P[b, a] = value
    value, vector = np.linalg.eigh(P)
    S = vector[:, -1] * np.sqrt(max(value[-1], 1e-12))
    left, size, right = np.linalg.svd(S.reshape(3, 3))
    start = unknowns[45:].reshape(9, 2).T @ S / (S @ S)
    arm = left[:, 0] * size[0]
    names = MOMENTUM_UNKNOWNS
    return dict(zip(names[:8], [*arm.tolist(), *start.tolist(), *right[0].tolist()], strict=True))
