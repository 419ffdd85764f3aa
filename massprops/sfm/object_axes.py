"""A COLMAP model of a room in which the object was turned over, in axes fixed to the object."""

from __future__ import annotations

import numpy as np
import pycolmap

from massprops.views import Views

SAME = 1e-6
"""Difference of two poses' numbers below which an image was not moved; of a turn or a length of the model's unit."""


def in_object_axes(model: pycolmap.Reconstruction, views: Views) -> pycolmap.Reconstruction:
    """The model with its images where they are about the object, and the points that go with them.

    The images of a placement that was joined move together, and so do points that they alone show: those are the object's
    or of the table below it. A point of the room, which several placements show, keeps its place among the images that did
    not move. Images that `views` lacks belong to no placement that was joined and are taken out.

    Args:
        model: as structure from motion made it.
        views: poses in the same unit, in the object's axes; those of some images are the model's own.
    """
    out = pycolmap.Reconstruction(model)
    manager = pycolmap.ObservationManager(out)
    row = {name: i for i, name in enumerate(views.names)}
    moves: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for image in list(out.images.values()):
        if not image.has_pose:
            continue
        i = row.get(image.name)
        if i is None:
            manager.deregister_frame(image.frame_id)
            continue
        pose = image.cam_from_world().matrix()
        moves[image.image_id] = views.move_from(i, pose[:, :3], pose[:, 3])
    still = np.eye(3), np.zeros(3)
    moved = {k for k, move in moves.items() if _differ(move, still) > SAME}
    if not moved:
        return out
    for number, point in list(out.points3D.items()):
        seen = [(e.image_id, e.point2D_idx) for e in point.track.elements]
        away = [e for e in seen if e[0] in moved]
        R, t = moves[seen[0][0]]
        if len(away) == len(seen) and all(_differ(moves[e[0]], (R, t)) < SAME for e in away):
            out.points3D[number].xyz = R @ point.xyz + t
        elif len(seen) - len(away) < 2:
            out.delete_point3D(number)
        else:
            for image_id, index in away:
                out.delete_observation(image_id, index)
    for image_id in moved:
        image = out.images[image_id]
        i = row[image.name]
        image.frame.rig_from_world = pycolmap.Rigid3d(np.column_stack([views.R[i], views.t[i]]))
    return out


def _differ(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> float:
    """Greatest difference of the numbers of two moves: R (3, 3), t (3,)."""
    return float(max(np.abs(a[0] - b[0]).max(), np.abs(a[1] - b[1]).max()))
