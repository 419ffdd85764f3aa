"""Something inside the body moves with friction: fuel, a loose part, a damper."""

from massprops.effects import Parameter

NAME = "energy-dissipation"
SENTENCE = "Something inside moves with friction (fuel, a damper): energy falls, angular momentum stays."
FORMULA = "momentum inside = share w_s;  w_s' + w x w_s = coupling (w - w_s)"
PARAMETERS = (
    Parameter("share", "1", 0.05, 1.0, least=0.0),
    Parameter("coupling", "s^-1", 0.1, 1e3, "pace", least=0.0),
)
NEEDS = ()
BODY = ("share", "coupling")
STATES = 3


def internal_start(w, p):
    """The inner sphere turns with the body at first; its momentum, body axes."""
    return p[0] * w[0], p[0] * w[1], p[0] * w[2]


def internal(t, z, p):
    """Momentum of a sphere of inertia `share` (of the body's mean moment)."""
    return z[0], z[1], z[2]


def internal_rate(t, w, z, p):
    """A viscous layer drives the sphere toward the body's rate: I_s (w_s' + w x w_s) = I_s coupling (w - w_s)."""
    drive = p[1] * p[0]
    return (
        drive * w[0] - p[1] * z[0] - (w[1] * z[2] - w[2] * z[1]),
        drive * w[1] - p[1] * z[1] - (w[2] * z[0] - w[0] * z[2]),
        drive * w[2] - p[1] * z[2] - (w[0] * z[1] - w[1] * z[0]),
    )


def internal_pace(p):
    """A stiff layer drives the sphere faster than the body turns; steps need only be stable."""
    return 0.4 * p[1]


MOMENTUM_UNKNOWNS = ("share",)


def momentum_columns(t, R, w, held):
    """Momentum of a sphere of the body's mean moment that the layer drives: for a `share` of one."""
    from massprops.dynamics.linear_recurrence import recurrence

    pace = held["coupling"]
    turning = (R @ w[:, :, None])[:, :, 0]
    keep = 2.718281828459045 ** (-pace * (t[1:] - t[:-1]))
    driven = 0.5 * (1.0 - keep)[:, None] * (turning[1:] + turning[:-1])
    # in inertial axes the layer alone changes it: d(R z)/dt = coupling R (w - z), exact for w constant over a step
    step = keep.repeat(3).reshape(-1, 3, 1, 1)
    z = recurrence(step, driven[:, :, None], turning[0][:, None])
    return {"internal": R.swapaxes(1, 2) @ z}


SCANNED = tuple(0.01 * 3.0 ** (0.5 * k) for k in range(11))


def momentum_scan(t, w):
    """From hardly any coupling over the record to one faster than the body turns, each 1.7 times the one before."""
    speed = float(((w * w).sum(axis=1) ** 0.5).mean())
    return [{"coupling": k * max(speed, 1e-12)} for k in SCANNED]


def momentum_steps(held, gap):
    """A third of the time constant: the scan is coarse."""
    return {"coupling": 0.3 * held["coupling"]}


def starts(span, speed):
    """Hardly any sphere, from slow to fast against the body's turning."""
    return [(1e-4, k * speed) for k in (0.03, 0.15, 0.6, 2.5, 10.0)]
