"""The lens bends the picture more than its calibration says."""

from massprops.effects import Parameter

NAME = "lens-distortion"
SENTENCE = "The lens bends the picture more than its calibration says."
FORMULA = "(x, y) seen = (1 + k1 r^2 + k2 r^4) (x, y), r^2 = x^2 + y^2"
PARAMETERS = (Parameter("k1", "1", 0.05, 2.0), Parameter("k2", "1", 0.1, 20.0))
NEEDS = ("tracks",)


def lens(x, y, p, focal):
    """Radial terms of the Brown model, as OpenCV's k1 and k2, on top of the calibration."""
    square = x * x + y * y
    factor = 1.0 + square * (p[0] + p[1] * square)
    return x * factor, y * factor
