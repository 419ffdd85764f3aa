"""Whether the images of a video follow each other as a turning body or a walking camera lets them."""

from __future__ import annotations

import numpy as np


def largest_jump(R: np.ndarray, times: np.ndarray) -> float:
    """Largest change of the turning rate between neighbouring pairs of steps, in units of the median rate.

    Images that overlap enough to be matched are a few degrees apart, and a free body's rate changes between them by a
    small part of itself (a turn of 0.1 rad changes by the square of that). A part linked the wrong way round throws
    the attitude by tens of degrees for good; one image that is held by few points is off by a few, and the next is not.

    Args:
        R: (n, 3, 3) world to camera; times: (n,) ascending, any unit.

    Returns:
        0 with fewer than five images.
    """
    from scipy.spatial.transform import Rotation

    if len(times) < 5:
        return 0.0
    turn = Rotation.from_matrix(R[2:] @ R[:-2].transpose(0, 2, 1)).as_rotvec()
    rate = turn / (times[2:] - times[:-2]).astype(float)[:, None]
    change = np.linalg.norm(rate[2:] - rate[:-2], axis=1)
    return float(change.max() / max(float(np.median(np.linalg.norm(rate, axis=1))), 1e-12))
