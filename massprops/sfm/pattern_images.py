"""Photographs of a repeating pattern that were left out, each placed by its clues to the whole model.

Pair by pair, what is unique of a pattern is too little where the camera went on by more than some ten degrees
(`massprops.sfm.pattern_pose` says how all pairs together tell).
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap

import cv2
import numpy as np
import pycolmap

from massprops.sfm.attempt import Features, ModelInputs
from massprops.sfm.convert import HALF, opencv_camera, to_points, to_views
from massprops.sfm.distinct import unit
from massprops.sfm.guided import place
from massprops.sfm.pattern_pose import Known, Photograph, find_pose

LEVEL = 0.1
"""Share by which the depths beside a feature may differ for the feature to be given one."""

MOST_POINTS = 3000
"""Points that are looked for: a photograph shows a third of them, and a pose is sure by dozens."""


def with_images_of_pattern(model: pycolmap.Reconstruction, given: ModelInputs) -> pycolmap.Reconstruction:
    """The model with every left-out image whose pose can be found; their points are to be found anew."""
    attempt = given.found
    known, clues = known_points(model, attempt.features, given.options.seed), _Clues(model, given)
    grown = pycolmap.Reconstruction(model)
    placed = set(known.views.names)
    remaining_names = [f.name for f in given.footage.frames if f.name in attempt.features and f.name not in placed]
    for done, name in enumerate(remaining_names):
        image = clues.photograph(name)
        rng = np.random.default_rng([given.options.seed, clues.numbers[name]])
        pose = None if image is None else find_pose(known, image, rng)
        if pose is not None:
            at = pycolmap.Rigid3d(np.column_stack([pose.R, pose.t]))
            record = pycolmap.Image(name=name, camera_id=clues.camera[name], image_id=clues.numbers[name])
            grown.add_image_with_trivial_frame(record, at)
        given.progress(done + 1, len(remaining_names), "placing by the pattern")
    return grown


def known_points(model: pycolmap.Reconstruction, features: Features, seed: int = 0) -> Known:
    """The placed images with what each observation looks like, of points drawn from all."""
    views, ids = to_views(model)
    points = to_points(model, ids)
    look = []
    for name, image_id in zip(views.names, ids, strict=True):
        seen = [(q.point3D_id, k) for k, q in enumerate(model.image(image_id).points2D) if q.has_point3D()]
        seen.sort(key=lambda s: s[0])
        look.append(features[name][1][[k for _, k in seen]])
    some = np.random.default_rng(seed).permutation(len(points.xyz))[:MOST_POINTS]
    keep = np.isin(points.obs_point, some)
    return Known(views, points.observed(keep), np.concatenate(look)[keep])


class _Clues:
    """What the matches of a database say of images that are not placed.

    Attributes:
        numbers: COLMAP's of each image; camera: that of its camera, by name.
    """

    def __init__(self, model: pycolmap.Reconstruction, given: ModelInputs) -> None:
        self.model, self.given = model, given
        self.views, self.ids = to_views(model)
        self.points = to_points(model, self.ids)
        with pycolmap.Database.open(given.found.database) as db:
            images = db.read_all_images()
        self.numbers = {image.name: int(image.image_id) for image in images}
        self.camera = {image.name: int(image.camera_id) for image in images}

    def photograph(self, name: str) -> Photograph | None:
        """An image with its clues; None where its camera is not known."""
        if not self.model.exists_camera(self.camera[name]):
            return None
        camera = self.model.camera(self.camera[name])
        K, distortion = opencv_camera(camera)
        keypoints, descriptors = self.given.found.features[name]
        uv = keypoints[:, :2].astype(float) - HALF
        ray = cv2.undistortPoints(uv[:, None], K, distortion)[:, 0] if len(uv) else uv
        feature, xyz = [np.zeros(0, int)], [np.zeros((0, 3))]
        with pycolmap.Database.open(self.given.found.database) as db:
            for row, other in enumerate(self.ids):
                matches = _matches(db, self.numbers[name], other)
                matched_features, there = self._in_space(row, matches)
                feature.append(matched_features)
                xyz.append(there)
        size = np.array([camera.width, camera.height])
        return Photograph(
            K=K,
            distortion=distortion,
            size=size,
            uv=uv,
            ray=ray,
            unit=unit(descriptors),
            feature=np.concatenate(feature),
            xyz=np.concatenate(xyz),
        )

    def _in_space(self, row: int, matches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Features (c,) of an image that match a placed one, and where (c, 3): at its point, or as deep as those beside."""
        if not len(matches):
            return np.zeros(0, int), np.zeros((0, 3))
        views, name = self.views, self.views.names[row]
        uv = self.given.found.features[name][0][matches[:, 1], :2] - HALF
        beside = place(views, self.points, row, uv)
        depth = beside.depth.mean(1)
        xyz = (beside.ray * depth[:, None] - views.t[row]) @ views.R[row]
        good = beside.depth[:, 1] < (1 + LEVEL) * beside.depth[:, 0]
        features = self.model.image(self.ids[row]).points2D
        for k, i in enumerate(matches[:, 1].tolist()):
            if features[i].has_point3D():
                xyz[k], good[k] = self.model.point3D(features[i].point3D_id).xyz, True
        return matches[good, 0], xyz[good]


def _matches(db: pycolmap.Database, own: int, other: int) -> np.ndarray:
    """(m, 2) places of matching features, also of pairs that too few of them match for a geometry."""
    if not db.exists_matches(own, other):
        return np.zeros((0, 2), int)
    return np.asarray(db.read_matches(own, other), int).reshape(-1, 2)
