"""The focal length is not what the calibration says."""

from massprops.effects import Parameter

NAME = "focal-length-error"
SENTENCE = "The focal length is not what the calibration says."
FORMULA = "(x, y) seen = (1 + relative) (x, y)"
PARAMETERS = (Parameter("relative", "1", 0.01, 0.5),)
NEEDS = ("tracks",)


def lens(x, y, p, focal):
    """The picture grows by a factor about the principal point."""
    return x * (1.0 + p[0]), y * (1.0 + p[0])
