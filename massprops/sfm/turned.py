"""Photographs taken sideways: one camera for all, its images turned the same way while it is solved.

A phone held upright and on its side has one focal length and one lens, but two image shapes. Features are turned by
quarter turns to the way in which most of its images are held, COLMAP sees one camera, and the finished model is turned
back: the images that everything else reads are upright, as the user sees them.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap

import numpy as np
import pycolmap

from massprops.sfm.footage import FootageRecord

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Camera axes (x right, y down, z forward) of an image after its pixels were turned clockwise."""


def turn_points(xy: np.ndarray, size: tuple[int, int], turn: int) -> np.ndarray:
    """Where places (k, 2) of an image go that is turned by `turn` quarter turns clockwise.

    Args:
        xy: [px], from the corner of the first pixel.
        size: width, height before [px].
    """
    w, h = size
    x, y = xy[:, 0], xy[:, 1]
    return np.stack([(x, y), (h - y, x), (w - x, h - y), (y, w - x)][turn % 4], axis=1)


def turn_keypoints(keypoints: np.ndarray, size: tuple[int, int], turn: int) -> np.ndarray:
    """Keypoints (k, 4) of x, y, scale, angle [rad] of an image that is turned."""
    out = keypoints.copy()
    out[:, :2] = turn_points(keypoints[:, :2], size, turn)
    out[:, 3] = np.mod(keypoints[:, 3] + turn * np.pi / 2, 2 * np.pi)
    return out


def turn_image(image: np.ndarray, turn: int) -> np.ndarray:
    """The image (h, w) or (h, w, 3) turned clockwise."""
    return np.ascontiguousarray(np.rot90(image, -turn))


def turn_camera(camera: pycolmap.Camera, turn: int, camera_id: int) -> pycolmap.Camera:
    """The camera that takes the turned images: the same lens."""
    size = (camera.width, camera.height)
    p = np.asarray(camera.params, float).copy()
    tangential = camera.model_name == "OPENCV"
    two = camera.model_name in ("PINHOLE", "OPENCV", "OPENCV_FISHEYE")
    place = slice(2, 4) if two else slice(1, 3)
    p[place] = turn_points(p[place][None], size, turn)[0]
    if two and turn % 2:
        p[:2] = p[1::-1]
    if tangential:
        # the tangential shift is r^2 v + 2 (x . v) x with v = (p2, p1): a vector of the image plane
        p[[7, 6]] = np.linalg.matrix_power(QUARTER, turn % 4)[:2, :2] @ p[[7, 6]]
    w, h = size[::-1] if turn % 2 else size
    out = pycolmap.Camera(camera_id=camera_id, model=camera.model_name, width=w, height=h, params=p)
    out.has_prior_focal_length = camera.has_prior_focal_length
    return out


def upright(model: pycolmap.Reconstruction, footage: FootageRecord) -> pycolmap.Reconstruction:
    """The model of the images as stored; itself where none was turned.

    Images that were turned get a camera of their own beside that of the others.
    """
    turns = {f.name: f.turn for f in footage.frames}
    back = {i: -turns[model.image(i).name] % 4 for i in model.reg_image_ids()}
    if footage.rig or not any(back.values()):
        return model
    out = pycolmap.Reconstruction()
    for camera in model.cameras.values():
        out.add_camera_with_trivial_rig(camera)
    copies: dict[tuple[int, int], int] = {}
    for image_id, turn in sorted(back.items()):
        image = model.image(image_id)
        camera = model.camera(image.camera_id)
        number = image.camera_id
        if turn:
            number = copies.get((image.camera_id, turn), max(out.cameras) + 1)
            if number not in out.cameras:
                copies[image.camera_id, turn] = number
                out.add_camera_with_trivial_rig(turn_camera(camera, turn, number))
        places = np.array([p.xy for p in image.points2D]).reshape(-1, 2)
        places = turn_points(places, (camera.width, camera.height), turn)
        pose = np.linalg.matrix_power(QUARTER, turn) @ np.asarray(image.cam_from_world().matrix())
        turned = pycolmap.Image(name=image.name, camera_id=number, image_id=image_id, keypoints=places)
        out.add_image_with_trivial_frame(turned, pycolmap.Rigid3d(pose))
    for point_id in sorted(model.point3D_ids()):
        point = model.point3D(point_id)
        track = pycolmap.Track([e for e in point.track.elements if e.image_id in back])
        out.add_point3D_with_id(point_id, pycolmap.Point3D(xyz=point.xyz, color=point.color, track=track))
    out.update_point_3d_errors()
    return out
