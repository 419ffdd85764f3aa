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
"""Turn to a neighbour [rad] from which on a polynomial through attitudes says nothing of the rate between them."""


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
        return self.duration * ((uv[:, self.axis] + 0.5) / size[:, self.axis] - 0.5)


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


def motion_of(views: Views, times: np.ndarray, middle: np.ndarray, reach: int = 2) -> Motion:
    """Velocities from the polynomial through each view and its neighbours in time.

    Args:
        times: (n,) in any unit; only views of one folder (one camera's stream) are neighbours.
        middle: (3,) world point about which the world turns, or the camera around it.
        reach: neighbours on either side; where some are missing or turned too far, one on either side, or two on one.
    """
    n = len(views)
    turn, shift, known = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, bool)
    stream = np.array([name.split("/", 1)[0] for name in views.names])
    for one in np.unique(stream):
        in_stream = np.flatnonzero(stream == one)
        in_stream = in_stream[np.argsort(times[in_stream], kind="stable")]
        for place, i in enumerate(in_stream):
            for near in _neighbours(in_stream, place, reach):
                rates = _rates(views, times, middle, int(i), near)
                if rates is not None:
                    (turn[i], shift[i]), known[i] = rates, True
                    break
    return Motion(middle, turn, shift, known)


def _neighbours(own: np.ndarray, place: int, reach: int) -> list[np.ndarray]:
    """Sets of neighbours of the view at a place of a stream, the best first."""
    sets = [own[place - k : place + k + 1] for k in range(reach, 0, -1) if k <= place < len(own) - k]
    if len(own) >= 3 and place in (0, len(own) - 1):
        sets.append(own[:3] if place == 0 else own[-3:])
    return [near[near != own[place]] for near in sets]


def _rates(
    views: Views, times: np.ndarray, middle: np.ndarray, i: int, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Angular velocity (3,) and velocity of `middle` (3,) of view i by its neighbours; None where these tell nothing."""
    late = times[near] - times[i]
    turned = views.R[near] @ views.R[i].T
    angles = np.stack([_rotation_vector(one) for one in turned])
    if len(np.unique(late)) < len(late) or not late.all() or np.linalg.norm(angles, axis=1).max() > WIDEST:
        return None
    unit = np.abs(late).max()
    powers = (late / unit)[:, None] ** np.arange(1, len(late) + 1)
    moved = (views.R[near] - views.R[i]) @ middle + views.t[near] - views.t[i]
    return np.linalg.solve(powers, angles)[0] / unit, np.linalg.solve(powers, moved)[0] / unit


def roughness(views: Views, points: SparsePoints, times: np.ndarray) -> float:
    """How far the motion is from what poses so far apart in time can tell: change of the points' speed in the images from a
    polynomial through three poses to one through five, over the speed (root mean squares)."""
    middle = np.median(points.xyz, axis=0)
    wide, narrow = (motion_of(views, times, middle, reach) for reach in (2, 1))
    both = (wide.known & narrow.known)[points.obs_view]
    view, xyz = points.obs_view[both], points.xyz[points.obs_point[both]]
    late = np.full(len(view), 1e-3)
    speed, other = (
        moved_on(views, m, view, xyz, late) - moved_on(views, m, view, xyz, 0.0 * late) for m in (wide, narrow)
    )
    return float(np.sqrt(np.sum((speed - other) ** 2) / max(float(np.sum(speed**2)), 1e-300)))


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
    return moved_on(views, motion, view, xyz, late) - moved_on(views, motion, view, xyz, 0.0 * late)


def row_jacobian(views: Views, points: SparsePoints, motion: Motion, readout: Readout, uv: np.ndarray) -> np.ndarray:
    """(k, 2) derivative of `row_shifts` by the readout's duration [px per unit of time]."""
    step = 1e-3
    more, less = (
        row_shifts(views, points, motion, Readout(readout.duration + s, readout.axis), uv) for s in (step, -step)
    )
    return (more - less) / (2 * step)


def _turned(rotation: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Vectors x (k, 3) turned by rotation vectors (k, 3) [rad] (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(rotation).apply(x)


def _rotation_vector(R: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_rotvec()
