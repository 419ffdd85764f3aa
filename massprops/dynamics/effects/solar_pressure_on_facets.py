"""Sunlight pushes on a body of any shape: on faces that look to all sides, along its way and by reflection."""

from functools import cache

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "solar-pressure-on-facets"
SENTENCE = "Sunlight pushes on the faces of the body, in proportion to how much of each is lit, and by reflection."
FORMULA = "torque = sum over faces with normals n: (n.s > 0) (n.s) (push x (-s) + (n.s) mirror), s toward the Sun"
GOLDEN = 0.5 * (1.0 + 5.0**0.5)
SOFT = 0.15


def _normals():
    """(20) the corners of a dodecahedron."""
    size = 3.0**0.5
    ones = (-1.0, 1.0)
    out = [(a / size, b / size, c / size) for a in ones for b in ones for c in ones]
    for turn in range(3):
        for a in ones:
            for b in ones:
                three = (0.0, a / GOLDEN / size, b * GOLDEN / size)
                out.append(tuple(three[(k - turn) % 3] for k in range(3)))
    return out


def _faces():
    """Of each face its normal and two directions across it."""
    out = []
    for n in _normals():
        least = min(range(3), key=lambda k: abs(n[k]))
        u = cross(*n, *(1.0 * (k == least) for k in range(3)))
        length = (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) ** 0.5
        u = tuple(x / length for x in u)
        out.append((*n, *u, *cross(*n, *u)))
    return tuple(out)


FACES = _faces()
PARAMETERS = tuple(
    Parameter(f"{kind}_{face}_{axis}", "rad s^-2", 1e-5, 1.0)
    for face in range(1, len(FACES) + 1)
    for kind, axis in (("push", "x"), ("push", "y"), ("push", "z"), ("mirror", "u"), ("mirror", "v"))
)
NEEDS = ("sun direction",)
BODY = tuple(q.name for q in PARAMETERS)
SEARCHED = False  # the balance of momentum finds it
LARGEST_TURN = 0.2
"""[rad] in a step of the derivatives: a face turns dark within SOFT; 0.4 leaves 2e-3 of their size, 0.2 4e-5."""


def torque(t, q, w, p, inertia, environment):
    """`push` is the force at full light times the centre of pressure of a face, `mirror` the torque of what is reflected, across
    the normal. Faces that look to twenty sides together push as a body of any other faces does, nearly."""
    x, y, z = to_body(*q, *environment.sun)
    a, b, c = 0.0 * x, 0.0 * x, 0.0 * x
    for k in range(20):
        f = FACES[k]
        cosine = x * f[0] + y * f[1] + z * f[2]
        # a face turns dark over some degrees: a corner would spoil the derivatives
        lit = 0.5 * (cosine + (cosine * cosine + SOFT * SOFT) ** 0.5)
        g, h, i = cross(p[5 * k], p[5 * k + 1], p[5 * k + 2], -x, -y, -z)
        u, v = lit * p[5 * k + 3], lit * p[5 * k + 4]
        a = a + lit * (g + u * f[3] + v * f[6])
        b = b + lit * (h + u * f[4] + v * f[7])
        c = c + lit * (i + u * f[5] + v * f[8])
    return a, b, c


def unit_torques(t, q, w, environment):
    """The torque of a unit of each parameter, in turn."""
    return _units(*to_body(*q, *environment.sun))


@cache
def momentum_prior():
    """(100, j): the unknowns as those of bodies that can be (`sunlit_bodies`), of unknowns that are independent."""
    import numpy as np

    from massprops.dynamics.sunlit_bodies import likely_unknowns

    return likely_unknowns(lambda sun: np.moveaxis(np.array(_units(*sun.T)), 2, 0).swapaxes(1, 2))


def _units(x, y, z):
    """The torque of a unit of each parameter, in turn, under a Sun in direction x, y, z of the body."""
    dark, out = 0.0 * x, []
    for f in FACES:
        cosine = x * f[0] + y * f[1] + z * f[2]
        lit = 0.5 * (cosine + (cosine * cosine + SOFT * SOFT) ** 0.5)
        out += [(dark, lit * z, -lit * y), (-lit * z, dark, lit * x), (lit * y, -lit * x, dark)]
        out += [tuple(lit * lit * f[k + j] for j in range(3)) for k in (3, 6)]
    return out
