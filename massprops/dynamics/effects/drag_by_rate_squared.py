"""The air brakes the rotation about each axis of the body by the square of its rate: a blade in a wind of its own."""

from massprops.effects import Parameter

NAME = "drag-by-rate-squared"
SENTENCE = (
    "The air brakes the rotation about each axis of the body by the square of its rate, each axis by its own amount."
)
FORMULA = "torque = -(drag_x |w_x| w_x, drag_y |w_y| w_y, drag_z |w_z| w_z)"
PARAMETERS = tuple(Parameter(f"drag_{a}", "rad^-1", 1e-2, 100.0, least=0.0) for a in "xyz")
NEEDS = ()
BODY = tuple(q.name for q in PARAMETERS)
SEARCHED = False  # the balance of momentum finds it
LAW_OF = "drag-by-axis"


def torque(t, q, w, p, inertia, environment):
    """Against the rate about each body axis, in proportion to its square."""
    a, b, c = w
    return -p[0] * a * (a * a) ** 0.5, -p[1] * b * (b * b) ** 0.5, -p[2] * c * (c * c) ** 0.5
