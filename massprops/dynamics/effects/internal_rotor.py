"""A wheel turns inside the body."""

from massprops.effects import Parameter

NAME = "internal-rotor"
SENTENCE = "A wheel inside the body carries angular momentum of its own."
PARAMETERS = tuple(Parameter(f"momentum_{a}", "rad s^-1", 1e-2, 1e3) for a in "xyz")
NEEDS = ()


def internal(t, z, p):
    """Momentum of the wheel against the body, over the mean moment, constant in body axes."""
    return p[0], p[1], p[2]
