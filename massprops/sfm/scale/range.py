"""A range finder: the measured distance to the centre of mass over the same distance in the reconstruction."""

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.errors import InputError
from massprops.sfm.scale._base import ScaleEstimate, ScaleInputs


def estimate(inputs: ScaleInputs) -> ScaleEstimate | None:
    """Median of range over |camera centre - centre of mass|; ranges are interpolated to the images of cam0.

    The sigma is that of a median, 1.253 robust standard deviations over the root of the count, and no less than the
    instrument's own. The focal length's error counts beside it: with one too long by 1 % the object is as much too far for its size.
    """
    r, views = inputs.range, inputs.views
    if r is None or views is None or inputs.centre_of_mass is None or len(r.range_m) == 0:
        return None
    of_first_camera = views.of_first_camera
    inside = (
        of_first_camera & (views.timestamp_ns >= r.timestamp_ns.min()) & (views.timestamp_ns <= r.timestamp_ns.max())
    )
    if inside.sum() < 3:
        raise InputError("range0/data.csv: no ranges at the times of the images; check that both use one clock")
    order = np.argsort(r.timestamp_ns, kind="stable")
    # relative nanoseconds: absolute ones do not fit a double
    start = r.timestamp_ns.min()
    measured = np.interp(
        (views.timestamp_ns[inside] - start).astype(float),
        (r.timestamp_ns[order] - start).astype(float),
        r.range_m[order],
    )
    ours = np.linalg.norm(views.centres[inside] - inputs.centre_of_mass, axis=1)
    ratio = measured / ours
    scale = float(np.median(ratio))
    spread = mad_sigma(ratio / scale - 1)
    count = min(int(inside.sum()), len(r.range_m))
    stated = (r.sigma_m or 0.0) / float(np.median(measured))
    sigma = np.hypot(1.253 * max(spread, stated) / np.sqrt(count), inputs.focal_sigma)
    warnings = ()
    if spread > max(0.02, 4 * stated):
        warnings = (
            f"range: measured and reconstructed distances scatter by {100 * spread:.1f} %; check the range data",
        )
    return ScaleEstimate("range", scale, float(sigma), warnings)
