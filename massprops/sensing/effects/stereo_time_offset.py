"""The second camera's pictures are taken earlier or later than stamped."""

from massprops.effects import Parameter

NAME = "stereo-time-offset"
SENTENCE = "The second camera takes its pictures earlier or later than the first."
FORMULA = "time of cam1 = timestamp + offset"
PARAMETERS = (Parameter("offset", "s", 1e-2, 10.0),)
NEEDS = ("stereo",)


def delay(camera, row, p):
    """Only camera 1 is late; `row` from -0.5 at the top to 0.5 at the bottom of the picture."""
    return p[0] * (camera == 1) + 0.0 * row
