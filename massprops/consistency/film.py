"""The inertia that a film's own adjustment shows, where its images were placed by one free motion (`massprops.sfm.along_motion`).

An estimator that reads such attitudes reads that motion over again, and takes their errors, which are alike in all images, for errors of
each. So the adjustment is asked itself, with its own covariance.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.estimators.attitude_information import LARGEST_SIGMA_K
from massprops.estimators.result import Estimate
from massprops.mass.ratio_space import log_components

FILM = "film"
FLOOR = 0.002
"""1-sigma of each of the five numbers that no residual shows: what features slide and the lens bends alike in all images. In the four
directions that a film shows best, three path-traced CubeSats were off by .0012 in the root mean square and by .003 at most, where the
residuals say .00004 to .002."""
STEP = 1e-5
"""Of the differences by which derivatives are taken."""


def film_estimate(run: Path, axes: np.ndarray) -> tuple[Estimate, np.ndarray] | None:
    """The estimate, and the covariance (5, 5) of its `log_components`; None where the images were not placed by one free motion.

    Args:
        run: the run folder.
        axes: (3, 3) the mesh's principal axes as columns, in the axes of `attitude0`.
    """
    from massprops.sfm.free_motion import BASIS, inertia_of_log

    try:
        with open_arrays(run / "work" / "sfm" / "precision.npz") as z:
            inertia, covariance = z["inertia"], z["inertia_covariance"]
    except (OSError, ValueError, KeyError):
        return None
    moments, film_axes = np.linalg.eigh(inertia)
    log = np.einsum("ij,kij->k", film_axes @ np.diag(np.log(moments)) @ film_axes.T, BASIS)

    def components(frame: np.ndarray) -> np.ndarray:
        ends = [log_components(inertia_of_log(log + s * STEP * np.eye(5)), frame) for s in (1, -1)]
        slope = (ends[0] - ends[1]).T / (2 * STEP)
        return np.asarray(slope @ covariance @ slope.T) + FLOOR**2 * np.eye(5)

    of_own = components(film_axes)
    k = log_components(inertia, film_axes)[:2]
    gap = np.array([k[1], k[0] + k[1], k[0]])
    sigma = np.sqrt(np.diag(of_own)[:2])
    shows = bool(sigma.max() <= LARGEST_SIGMA_K)
    estimate = Estimate(
        FILM,
        converged=True,
        observable=shows,
        reason="" if shows else f"the film does not show k1 and k2 (1-sigma {sigma[0]:.2g}, {sigma[1]:.2g})",
        k1=float(k[0]) if shows else None,
        k2=float(k[1]) if shows else None,
        k_covariance=of_own[:2, :2],
        inertia=inertia / np.trace(inertia),
        principal_axes=film_axes,
        axes_covariance=film_axes @ (of_own[2:, 2:] / np.outer(gap, gap)) @ film_axes.T
        if np.abs(gap).min() > 0
        else None,
        body_frame="attitude0",
        reliable=True,
        memory_counted=True,
    )
    return estimate, components(axes)
