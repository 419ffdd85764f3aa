"""Sunlight pushes on a plate or a wing: the more, the more of it the Sun sees."""

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "solar-pressure-on-plate"
SENTENCE = "Sunlight pushes on a plate or a wing, in proportion to how much of it is lit from either side."
FORMULA = "torque = (s.n) (front (s.n > 0) - back (s.n < 0)) x (-s), s toward the Sun, n normal to the plate"
PARAMETERS = (
    *(Parameter(f"front_{a}", "rad s^-2", 1e-4, 1.0) for a in "xyz"),
    *(Parameter(f"back_{a}", "rad s^-2", 1e-4, 1.0) for a in "xyz"),
    *(Parameter(f"normal_{a}", "1", 1.0, 1.0, "direction") for a in "xyz"),
)
NEEDS = ("sun direction",)
SEARCHED = False
DIRECTIONS = 80
SOFT = 0.15


def torque(t, q, w, p, inertia, around):
    """The share of a plate that is lit goes with the cosine of the Sun's angle from its normal; `front` and `back` are
    force at full light times the centre of pressure of either side. Light that is reflected is left out."""
    x, y, z = to_body(*q, *around.sun)
    length = (p[6] * p[6] + p[7] * p[7] + p[8] * p[8] + 1e-24) ** 0.5
    cosine = (x * p[6] + y * p[7] + z * p[8]) / length
    # the two sides take turns over some degrees: no plate is flat, and a corner would spoil the derivatives
    size = (cosine * cosine + SOFT * SOFT) ** 0.5
    front, back = 0.5 * (size + cosine), 0.5 * (size - cosine)
    return cross(front * p[0] + back * p[3], front * p[1] + back * p[4], front * p[2] + back * p[5], -x, -y, -z)


MOMENTUM_UNKNOWNS = tuple(f"{side}_{a}" for side in ("front", "back") for a in "xyz")


def momentum_scan(t, w):
    """Normals spread evenly over half a sphere (Fibonacci's spiral): the other half is the same plate from behind."""
    out = []
    for k in range(DIRECTIONS):
        z = (k + 0.5) / DIRECTIONS
        turned = 1j ** (4.0 * 0.6180339887498949 * k) * (1.0 - z * z) ** 0.5
        out.append({"normal_x": turned.real, "normal_y": turned.imag, "normal_z": z})
    return out


def momentum_steps(held, gap):
    """A few degrees."""
    return {"normal_x": 0.06, "normal_y": 0.06, "normal_z": 0.06}
