"""The rows of a picture are taken one after the other."""

from massprops.effects import Parameter

NAME = "rolling-shutter"
SENTENCE = "The rows of a picture are taken one after the other, not at once."
FORMULA = "time of a row = timestamp + readout row, row from -1/2 to 1/2"
PARAMETERS = (Parameter("readout", "s", 1e-2, 10.0),)
NEEDS = ("tracks",)


def delay(camera, row, p):
    """The middle row is on time; `row` from -0.5 at the top to 0.5 at the bottom of the picture."""
    return p[0] * row
