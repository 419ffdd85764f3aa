"""The chaser turns slowly though it is taken to keep its attitude."""

from massprops.effects import Parameter

NAME = "chaser-rotation-drift"
SENTENCE = "The chaser itself turns slowly though it is taken to hold still."
FORMULA = "cam0 turns by rate t"
PARAMETERS = tuple(Parameter(f"rate_{a}", "rad s^-1", 1e-4, 1.0) for a in "xyz")
NEEDS = ("camera",)


def turn(t, p):
    """Rotation vector of cam0 since the first timestamp, its own axes: constant rate."""
    return t * p[0], t * p[1], t * p[2]
