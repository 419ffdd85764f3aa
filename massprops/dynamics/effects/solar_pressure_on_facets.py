"""Sunlight pushes on a body of any shape: on faces that look to all sides, along its way and by reflection."""

from massprops.dynamics.kernels import cross, to_body
from massprops.effects import Parameter

NAME = "solar-pressure-on-facets"
SENTENCE = "Sunlight pushes on the faces of the body, in proportion to how much of each is lit, and by reflection."
FORMULA = "torque = sum over faces with normals n: (n.s > 0) (n.s) (push x (-s) + (n.s) mirror), s toward the Sun"
GOLDEN = 0.5 * (1.0 + 5.0**0.5)
LENGTH = (1.0 + GOLDEN * GOLDEN) ** 0.5
SOFT = 0.15


def _faces():
    """Of each face its normal and two directions across it: the corners of an icosahedron, the axes taken in turn."""
    out = []
    for turn in range(3):
        for a in (1.0 / LENGTH, -1.0 / LENGTH):
            for b in (GOLDEN / LENGTH, -GOLDEN / LENGTH):
                three = ((0.0, a, b), (1.0, 0.0, 0.0), (0.0, b, -a))
                out.append(tuple(v[(k - turn) % 3] for v in three for k in range(3)))
    return tuple(out)


FACES = _faces()
PARAMETERS = tuple(
    Parameter(f"{kind}_{face}_{axis}", "rad s^-2", 1e-5, 1.0)
    for face in range(1, len(FACES) + 1)
    for kind, axis in (("push", "x"), ("push", "y"), ("push", "z"), ("mirror", "u"), ("mirror", "v"))
)
NEEDS = ("sun direction",)
SEARCHED = False  # the balance of momentum finds it


def torque(t, q, w, p, inertia, around):
    """`push` is the force at full light times the centre of pressure of a face, `mirror` the torque of what is reflected, across
    the normal. Faces that look to twelve sides together push as a body of any other faces does, nearly."""
    x, y, z = to_body(*q, *around.sun)
    a, b, c = 0.0 * x, 0.0 * x, 0.0 * x
    for k in range(12):
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


def unit_torques(t, q, w, around):
    """The torque of a unit of each parameter, in turn."""
    x, y, z = to_body(*q, *around.sun)
    dark, out = 0.0 * x, []
    for f in FACES:
        cosine = x * f[0] + y * f[1] + z * f[2]
        lit = 0.5 * (cosine + (cosine * cosine + SOFT * SOFT) ** 0.5)
        out += [(dark, lit * z, -lit * y), (-lit * z, dark, lit * x), (lit * y, -lit * x, dark)]
        out += [tuple(lit * lit * f[k + j] for j in range(3)) for k in (3, 6)]
    return out
