"""The two cameras stand farther apart or closer than the calibration says."""

from massprops.effects import Parameter

NAME = "baseline-error"
SENTENCE = "The two cameras stand farther apart or closer than the calibration says."
FORMULA = "baseline = (1 + relative) baseline given"
PARAMETERS = (Parameter("relative", "1", 0.01, 0.5),)
NEEDS = ("stereo",)


def base(camera, t, p):
    """Place (3,) of a camera in the chaser's frame."""
    return t if camera == 0 else t * (1.0 + p[0])
