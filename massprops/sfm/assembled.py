"""One COLMAP model put together from several, each where it is thought to lie, with observations added."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pycolmap


class Similarity(NamedTuple):
    """x -> scale R x + t, R (3, 3), t (3,)."""

    scale: float
    R: np.ndarray
    t: np.ndarray

    def after(self, first: Similarity) -> Similarity:
        """The motion that does `first`, then this."""
        return Similarity(self.scale * first.scale, self.R @ first.R, self.scale * self.R @ first.t + self.t)


STAYS = Similarity(1.0, np.eye(3), np.zeros(3))
"""The part that the others are moved to."""


class Part(NamedTuple):
    """The images `ids` of a model, and where they go."""

    model: pycolmap.Reconstruction
    ids: frozenset[int]
    to: Similarity


class Sighting(NamedTuple):
    """A point of a part, by its number there, in an image (COLMAP's number), at uv (2,) [px, centres of pixels at whole numbers]."""

    part: int
    point: int
    image: int
    uv: np.ndarray


def assemble(parts: Sequence[Part], sightings: Sequence[Sighting] = ()) -> pycolmap.Reconstruction:
    """The model of all parts, which share no image; cameras are those of the first part that has them.

    A part that another focal length was found for is brought nearer or farther, until it is as large in its images.
    """
    out = pycolmap.Reconstruction()
    extra: dict[int, list[np.ndarray]] = {}
    index: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for s in sightings:
        image_places = extra.setdefault(s.image, [])
        index.setdefault((s.part, s.point), []).append((s.image, len(image_places)))
        image_places.append(s.uv + 0.5)
    before: dict[int, int] = {}
    for model, ids, to in parts:
        for image_id in sorted(ids):
            image = model.image(image_id)
            if not out.exists_camera(image.camera_id):
                out.add_camera_with_trivial_rig(model.camera(image.camera_id))
            places = np.array([p.xy for p in image.points2D]).reshape(-1, 2)
            before[image_id] = len(places)
            places = np.concatenate([places, *(np.reshape(e, (1, 2)) for e in extra.get(image_id, []))])
            pose = _posed(model, image, out.camera(image.camera_id))
            R = pose[:, :3] @ to.R.T
            moved = pycolmap.Rigid3d(np.column_stack([R, to.scale * pose[:, 3] - R @ to.t]))
            new = pycolmap.Image(name=image.name, camera_id=image.camera_id, image_id=image_id, keypoints=places)
            out.add_image_with_trivial_frame(new, moved)
    for number, (model, ids, to) in enumerate(parts):
        for point_id in sorted(model.point3D_ids()):
            point = model.point3D(point_id)
            track = [e for e in point.track.elements if e.image_id in ids]
            if len(track) < 2:
                continue
            added = [pycolmap.TrackElement(i, before[i] + k) for i, k in index.get((number, point_id), [])]
            xyz = to.scale * to.R @ point.xyz + to.t
            out.add_point3D(xyz, pycolmap.Track([*track, *added]), point.color)
    out.update_point_3d_errors()
    return out


def _posed(model: pycolmap.Reconstruction, image: pycolmap.Image, camera: pycolmap.Camera) -> np.ndarray:
    """(3, 4) pose of an image of a model for another camera."""
    pose = np.array(image.cam_from_world().matrix(), float)
    change = camera.mean_focal_length() / model.camera(image.camera_id).mean_focal_length() - 1.0
    seen = [model.point3D(p.point3D_id).xyz for p in image.points2D if p.has_point3D()] if change else []
    if seen:
        pose[2, 3] += change * (pose[2, :3] @ np.median(seen, axis=0) + pose[2, 3])
    return pose
