"""The COLMAP database written by hand: cameras, rigs, frames, images, features."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pycolmap

from massprops.errors import InputError
from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord

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
    """Writes cameras, rigs, frames, images and features; gives the image ids by name.

    The images of a rig's cameras that share a file name form one frame of the rig. Cameras that are not mounted
    together are each a rig of their own, and each of their images a frame.
    """
    frames: dict[str, list[FrameRecord]] = {}
    for f in footage.frames:
        if f.name in features:
            frames.setdefault(f.moment if footage.rig else f.name, []).append(f)
    ids = {f.name: i for i, f in enumerate((f for taken_together in frames.values() for f in taken_together), start=1)}
    with pycolmap.Database.open(path) as db, pycolmap.DatabaseTransaction(db):
        for record in footage.cameras:
            db.write_camera(prior_camera(record), use_camera_id=True)
        for rig in _rigs(footage):
            db.write_rig(rig, use_rig_id=True)
        for frame_id, taken_together in enumerate(frames.values(), start=1):
            frame = pycolmap.Frame(frame_id=frame_id, rig_id=1 if footage.rig else taken_together[0].camera + 1)
            images = []
            for f in taken_together:
                image = pycolmap.Image(name=f.name, camera_id=f.camera + 1, image_id=ids[f.name])
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


def _rigs(footage: FootageRecord) -> list[pycolmap.Rig]:
    sensors = [prior_camera(record).sensor_id for record in footage.cameras]
    if not footage.rig:
        rigs = [pycolmap.Rig(rig_id=record.id + 1) for record in footage.cameras]
        for rig, sensor in zip(rigs, sensors, strict=True):
            rig.add_ref_sensor(sensor)
        return rigs
    poses = rig_pose(footage.cameras)
    rig = pycolmap.Rig(rig_id=1)
    rig.add_ref_sensor(sensors[0])
    for record, sensor in zip(footage.cameras[1:], sensors[1:], strict=True):
        rig.add_sensor(sensor, pycolmap.Rigid3d(poses[record.id][:3]))
    return [rig]


def image_numbers(database: Path) -> dict[str, int]:
    """COLMAP's number of each image, by name."""
    with pycolmap.Database.open(database) as db:
        return {image.name: int(image.image_id) for image in db.read_all_images()}


def drop_pairs(database: Path, pairs: Iterable[tuple[int, int]]) -> None:
    """Takes out the matches of pairs of images.

    Each is asked for: a pair that was compared in vain is in no list of COLMAP's.
    """
    with pycolmap.Database.open(database) as db:
        for a, b in pairs:
            if db.exists_matches(a, b):
                db.delete_matches(a, b)
            if db.exists_two_view_geometry(a, b):
                db.delete_two_view_geometry(a, b)
