"""Where an image's rows were exposed one after the other: how far that moves what they show.

A rolling shutter takes row v at the image's time plus `readout` (v - middle) / height. Until then the body has moved on
(or the camera, which is the same). Each view's motion follows from the poses before and after it; the shift of an
observation is the projection at its row's time minus that at the image's own (Hedborg et al. 2012, "Rolling shutter
bundle adjustment", with velocities from the neighbours in place of free ones). Nothing here needs pycolmap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.sfm.points import SparsePoints, project_camera
from massprops.views import Views

WIDEST = np.deg2rad(60.0)
"""Turn to a neighbour [rad] from which on a parabola through three attitudes says nothing of the rate between them."""


@dataclass(frozen=True)
class Readout:
    """How the rows of an image follow each other.

    Attributes:
        duration: from the first row to the last, in units of the views' times; negative from the bottom up.
        axis: 1 where rows follow each other, 0 where columns do (a telephone held on its side).
    """

    duration: float
    axis: int = 1

    def delays(self, uv: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Time (k,) after the image's own at which the places uv (k, 2) [px] were exposed; size (k, 2) [px]."""
        late: np.ndarray = self.duration * ((uv[:, self.axis] + 0.5) / size[:, self.axis] - 0.5)
        return late


@dataclass(frozen=True)
class Motion:
    """Of n views: how the world moves before the camera, about its point `middle` (3,).

    Attributes:
        middle: world point whose path is taken as straight.
        turn: (n, 3) angular velocity in camera axes [rad per unit of time]; 0 where `known` is false.
        shift: (n, 3) velocity of `middle` in camera axes.
        known: (n,) bool.
    """

    middle: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    known: np.ndarray


@dataclass(frozen=True)
class Seen:
    """A model as arrays: `points` with the observations as they stand in it, perhaps moved to where a global shutter would see
    them; uv (k, 2) where they were seen [px]; the motion of its views."""

    views: Views
    ids: list[int]
    points: SparsePoints
    uv: np.ndarray
    motion: Motion


def motion_of(views: Views, times: np.ndarray, middle: np.ndarray) -> Motion:
    """Velocities from parabolas through each view and the views before and after it, or two on one side at an end.

    Args:
        times: (n,) in any unit; only views of one folder (one camera's stream) are neighbours.
        middle: (3,) world point about which the world turns, or the camera around it.
    """
    n = len(views)
    centre = views.R @ middle + views.t
    turn, shift, known = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, bool)
    stream = np.array([name.split("/", 1)[0] for name in views.names])
    for one in np.unique(stream):
        own = np.flatnonzero(stream == one)
        own = own[np.argsort(times[own], kind="stable")]
        for place, i in enumerate(own) if len(own) >= 3 else ():
            first = min(max(place - 1, 0), len(own) - 3)
            j, k = (q for q in own[first : first + 3] if q != i)
            late = times[[j, k]] - times[i]
            angles = np.stack([_rotation_vector(views.R[q] @ views.R[i].T) for q in (j, k)])
            if late[0] == late[1] or not late.all() or np.linalg.norm(angles, axis=1).max() > WIDEST:
                continue
            parabola = np.stack([late, late**2], 1)
            turn[i] = np.linalg.solve(parabola, angles)[0]
            shift[i] = np.linalg.solve(parabola, centre[[j, k]] - centre[i])[0]
            known[i] = True
    return Motion(middle, turn, shift, known)


def moved_on(views: Views, motion: Motion, view: np.ndarray, xyz: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Pixels (k, 2) of world points (k, 3) in the views `view` (k,), `late` (k,) after the views' own times."""
    about = np.einsum("kij,kj->ki", views.R[view], xyz - motion.middle)
    centre = views.R[view] @ motion.middle + views.t[view]
    place = _turned(motion.turn[view] * late[:, None], about) + centre + motion.shift[view] * late[:, None]
    return project_camera(views.K[view], views.distortion[view], place)


def row_shifts(views: Views, points: SparsePoints, motion: Motion, readout: Readout, uv: np.ndarray) -> np.ndarray:
    """(k, 2) how far the shutter moved each observation from where a global one would have seen it [px].

    Args:
        uv: (k, 2) where each was seen, which says when [px].
    """
    view, xyz = points.obs_view, points.xyz[points.obs_point]
    late = readout.delays(uv, views.size[view])
    shifts: np.ndarray = moved_on(views, motion, view, xyz, late) - moved_on(views, motion, view, xyz, 0.0 * late)
    return shifts


def row_slopes(views: Views, points: SparsePoints, motion: Motion, readout: Readout, uv: np.ndarray) -> np.ndarray:
    """(k, 2) derivative of `row_shifts` by the readout's duration [px per unit of time]."""
    step = 1e-3
    more, less = (
        row_shifts(views, points, motion, Readout(readout.duration + s, readout.axis), uv) for s in (step, -step)
    )
    slopes: np.ndarray = (more - less) / (2 * step)
    return slopes


def _turned(rotation: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Vectors x (k, 3) turned by rotation vectors (k, 3) [rad] (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    out: np.ndarray = Rotation.from_rotvec(rotation).apply(x)
    return out


def _rotation_vector(R: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    out: np.ndarray = Rotation.from_matrix(R).as_rotvec()
    return out
