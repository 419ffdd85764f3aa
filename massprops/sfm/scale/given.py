"""`--scale`: metres per model unit, that is the object's greatest length in metres."""

from massprops.errors import InputError
from massprops.sfm.scale._base import ScaleEstimate, ScaleInputs


def estimate(inputs: ScaleInputs) -> ScaleEstimate | None:
    """Exact but for `given_sigma`."""
    if inputs.given is None:
        return None
    if not inputs.given > 0:
        raise InputError(f"--scale {inputs.given}: must be above 0; give the object's greatest length in metres")
    return ScaleEstimate("given", inputs.given / inputs.length, inputs.given_sigma)
