"""The COLMAP database written by hand: cameras, rig, frames, images, features."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path

import numpy as np
import pycolmap

from massprops.errors import InputError
from massprops.sfm.footage import CameraRecord, FootageRecord

FOCAL_FACTOR = 1.2
"""Prior focal length in units of the longer side, COLMAP's default."""


def prior_camera(record: CameraRecord) -> pycolmap.Camera:
    """The camera before reconstruction: SIMPLE_RADIAL, or OPENCV when the footage gives a distortion.

    COLMAP counts pixels from the corner of the first one, OpenCV from its centre: half a pixel is added.
    """
    w, h = record.size
    focal = record.focal_px or FOCAL_FACTOR * max(w, h)
    cx, cy = (
        (record.principal_point[0] + 0.5, record.principal_point[1] + 0.5) if record.principal_point else (w / 2, h / 2)
    )
    if record.distortion is not None and np.any(record.distortion):
        model, params = "OPENCV", [focal, focal, cx, cy, *record.distortion]
    else:
        model, params = "SIMPLE_RADIAL", [focal, cx, cy, 0.0]
    camera = pycolmap.Camera(camera_id=record.id + 1, model=model, width=w, height=h, params=params)
    camera.has_prior_focal_length = record.focal_px is not None
    return camera


def rig_pose(cameras: tuple[CameraRecord, ...]) -> dict[int, np.ndarray]:
    """(4, 4) camera-from-rig of every camera by number; the rig is the first camera's frame [m].

    Raises:
        InputError: a second camera without its mounting.
    """
    first = cameras[0].T_BS if cameras[0].T_BS is not None else np.eye(4)
    poses = {cameras[0].id: np.eye(4)}
    for c in cameras[1:]:
        if c.T_BS is None:
            raise InputError(f"cam{c.id}/sensor.yaml: T_BS is needed to use two cameras together; add it")
        poses[c.id] = np.linalg.inv(c.T_BS) @ first
    return poses


def write_database(
    path: Path, footage: FootageRecord, features: dict[str, tuple[np.ndarray, np.ndarray]]
) -> dict[str, int]:
    """Writes cameras, one rig, frames, images and features; gives the image ids by name.

    Images of several cameras that share a file name form one frame of the rig.
    """
    poses = rig_pose(footage.cameras)
    ids: dict[str, int] = {}
    groups: dict[str, list[str]] = {}
    by_name = {f.name: f for f in footage.frames}
    for f in footage.frames:
        if f.name in features:
            key = f.name.split("/", 1)[1] if len(footage.cameras) > 1 else f.name
            groups.setdefault(key, []).append(f.name)
    with pycolmap.Database.open(path) as db:
        rig = pycolmap.Rig(rig_id=1)
        for i, record in enumerate(footage.cameras):
            camera = prior_camera(record)
            db.write_camera(camera, use_camera_id=True)
            if i == 0:
                rig.add_ref_sensor(camera.sensor_id)
            else:
                rig.add_sensor(camera.sensor_id, pycolmap.Rigid3d(poses[record.id][:3]))
        db.write_rig(rig, use_rig_id=True)
        for name in (n for group in groups.values() for n in group):
            ids[name] = len(ids) + 1
        for frame_id, names in enumerate(groups.values(), start=1):
            frame = pycolmap.Frame(frame_id=frame_id, rig_id=1)
            images = []
            for name in names:
                image = pycolmap.Image(name=name, camera_id=by_name[name].camera + 1, image_id=ids[name])
                image.frame_id = frame_id
                frame.add_data_id(image.data_id)
                images.append(image)
            db.write_frame(frame, use_frame_id=True)
            for image in images:
                db.write_image(image, use_image_id=True)
                keypoints, descriptors = features[image.name]
                db.write_keypoints(image.image_id, keypoints)
                db.write_descriptors(
                    image.image_id,
                    pycolmap.FeatureDescriptors(type=pycolmap.FeatureExtractorType.SIFT, data=descriptors),
                )
    return ids
