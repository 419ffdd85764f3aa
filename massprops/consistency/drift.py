"""How much less sure the point that a body turns about is, where cameras drift over a film.

The outlines show by how many pixels the cameras are wrong from one end of a film to the other
(`massprops.surface.outline_gaps`): heavy compression, for one, holds blocks of the images still while the body turns. The
residuals of the features show nothing of it, as neighbouring images agree. So slow turns and shifts of that size are put to the
poses, and the point is computed anew for each draw.
"""

from __future__ import annotations

import numpy as np

from massprops.consistency.mesh_side import MeshSide
from massprops.consistency.motion_side import centre_of_motion
from massprops.dynamics.quaternion import from_rotation_matrix, from_rotation_vector, multiply, rotation_matrix
from massprops.views import Views

DRAWS = 32
WAVES = 3
"""Half waves over the record of which a drift is made: slower than the turn of the body itself, and none that neighbours show."""


def centre_drift(views: Views, stamp_ns: np.ndarray, pixels: float, mesh: MeshSide) -> np.ndarray:
    """(3, 3) covariance of the point that the body turns about, in the mesh's axes and units, where outlines show a drift.

    An outline half the body's length away from its middle moves so far by a turn about the line of sight; and by a shift across
    it, or along it in proportion to the distance.

    Args:
        views: n images of cam0 in the order of time; stamp_ns: (n,).
        pixels: 1-sigma of the drift [px].
    """
    away = float(np.median(views.t[:, 2])) * mesh.factor
    share = pixels * away / (0.5 * mesh.length * float(np.median(views.K[:, 0, 0])))
    shift = share * np.array([0.5 * mesh.length, 0.5 * mesh.length, away])
    times, q, t = (stamp_ns - stamp_ns[0]) * 1e-9, from_rotation_matrix(views.R), views.t * mesh.factor
    here = centre_of_motion(stamp_ns, views.R, t, mesh.length)
    if here is None:
        return np.zeros((3, 3))
    rng, moved = np.random.default_rng(0), [np.zeros(3)]
    for _ in range(DRAWS):
        turned = rotation_matrix(multiply(from_rotation_vector(share * slow(times, rng)), q))
        drifted_centre = centre_of_motion(stamp_ns, turned, t + shift * slow(times, rng), mesh.length)
        if drifted_centre is not None:
            moved.append(drifted_centre.place - here.place)
    return np.asarray(np.transpose(moved) @ np.array(moved) / len(moved))


def slow(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) a drift of 1-sigma 1 in each direction."""
    share = (times - times[0]) / max(float(times[-1] - times[0]), 1e-12)
    waves = np.cos(np.pi * np.arange(1, WAVES + 1) * share[:, None]) * np.sqrt(2.0 / WAVES)
    return np.asarray(waves @ rng.standard_normal((WAVES, 3)))
