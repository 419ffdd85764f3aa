"""The range sensor reads too long or too short by a constant."""

from massprops.effects import Parameter

NAME = "range-bias"
SENTENCE = "The range sensor reads too long or too short by a constant."
FORMULA = "range read = range + bias"
PARAMETERS = (Parameter("bias", "m", 0.05, 1e3),)
NEEDS = ("range",)


def range_offset(t, p):
    """The same at all times."""
    return p[0] + 0.0 * t
