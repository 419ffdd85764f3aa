"""COLMAP models to plain arrays: pinhole views with OpenCV's distortion, points and their observations."""

from __future__ import annotations

import tempfile
import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pycolmap

from massprops.errors import InputError
from massprops.sfm.fisheye import rational
from massprops.sfm.model_bytes import read_places, read_points, write_model
from massprops.sfm.points import SparsePoints
from massprops.views import Views

HALF = 0.5
"""COLMAP's pixels begin at the corner of the first one, OpenCV's at its centre."""


def opencv_camera(camera: pycolmap.Camera) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) pinhole matrix and OpenCV's distortion with its pixel centres, the same projection.

    The distortion is (4,) k1, k2, p1, p2, or for a fisheye (8,) with k3 to k6.

    Raises:
        InputError: a model that these numbers cannot express.
    """
    p = np.asarray(camera.params, float)
    name = camera.model_name
    distortion = np.zeros(4)
    if name in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"):
        fu = fv = p[0]
        cu, cv = p[1:3]
        distortion[: len(p) - 3] = p[3:]
    elif name in ("PINHOLE", "OPENCV"):
        fu, fv, cu, cv = p[:4]
        distortion[: len(p) - 4] = p[4:]
    elif name == "FULL_OPENCV":
        fu, fv, cu, cv = p[:4]
        distortion = p[4:]
    elif name.endswith("_FISHEYE") and name.removesuffix("_FISHEYE") in ("SIMPLE_RADIAL", "RADIAL", "OPENCV"):
        fu, fv, cu, cv = p[:4] if name == "OPENCV_FISHEYE" else (p[0], p[0], *p[1:3])
        terms = p[4:] if name == "OPENCV_FISHEYE" else p[3:]
        distortion = rational(np.pad(terms, (0, 4 - len(terms))), image_radius(camera, fu, cu, cv))
    else:
        raise InputError(
            f"camera model {name} cannot be used; undistort the images or rebuild the model with OPENCV or SIMPLE_RADIAL"
        )
    K = np.array([[fu, 0, cu - HALF], [0, fv, cv - HALF], [0, 0, 1.0]])
    return K, distortion


def image_radius(camera: pycolmap.Camera, focal: float, cu: float, cv: float) -> float:
    """Distance of the farthest corner of the image from the principal point (cu, cv) [px], over the focal length [px]."""
    return float(np.hypot(max(cu, camera.width - cu), max(cv, camera.height - cv)) / focal)


def to_views(model: pycolmap.Reconstruction, timestamps: dict[str, int] | None = None) -> tuple[Views, list[int]]:
    """Registered images in the order of their names, and their COLMAP numbers."""
    images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda im: im.name)
    K, D, R, t, size = [], [], [], [], []
    for image in images:
        camera = model.camera(image.camera_id)
        k, d = opencv_camera(camera)
        m = np.asarray(image.cam_from_world().matrix())
        K.append(k)
        D.append(d)
        R.append(m[:, :3])
        t.append(m[:, 3])
        size.append((camera.width, camera.height))
    stamps = np.array([(timestamps or {}).get(im.name, -1) for im in images], np.int64)
    n = len(images)
    width = max((len(d) for d in D), default=4)
    D = [np.pad(d, (0, width - len(d))) for d in D]
    views = Views(
        tuple(im.name for im in images),
        stamps,
        np.array(size, int).reshape(n, 2),
        np.array(K, float).reshape(n, 3, 3),
        np.array(D, float).reshape(n, width),
        np.array(R, float).reshape(n, 3, 3),
        np.array(t, float).reshape(n, 3),
    )
    return views, [im.image_id for im in images]


def to_points(model: pycolmap.Reconstruction, image_ids: list[int]) -> SparsePoints:
    """Points in the order of their numbers, with every observation in the given images.

    They are read from what COLMAP writes, since it hands them out one at a time, which takes three times as long.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_model(model, Path(folder))
        by_image = read_places(Path(folder))
        points = read_points(Path(folder))
    order = np.argsort(points["id"])
    number = points["id"][order]
    view, row, uv = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)], [np.zeros((0, 2))]
    for i, image_id in enumerate(image_ids):
        place = by_image[image_id]
        place = place[place["point"] >= 0]
        place = place[np.argsort(place["point"], kind="stable")]
        view.append(np.full(len(place), i, np.int32))
        row.append(np.searchsorted(number, place["point"]).astype(np.int32))
        uv.append(place["uv"])
    return SparsePoints(
        number.astype(np.int64),
        points["xyz"][order],
        points["rgb"][order],
        points["error"][order],
        np.concatenate(view),
        np.concatenate(row),
        np.concatenate(uv) - HALF,
    )


def take_out_images(model: pycolmap.Reconstruction, ids: Iterable[int]) -> None:
    """Takes images (COLMAP's numbers) out of the model, in place, with those of the same rig and moment."""
    manager = pycolmap.ObservationManager(model)
    for frame_id in sorted({model.image(i).frame_id for i in ids}):
        manager.deregister_frame(frame_id)


def of_one_moment(model: pycolmap.Reconstruction, ids: Iterable[int]) -> frozenset[int]:
    """Placed images (COLMAP's numbers) with those of the same rig and moment: where one camera's are told apart, the other's go along."""
    frames = {model.image(i).frame_id for i in ids}
    return frozenset(i for i in model.reg_image_ids() if model.image(i).frame_id in frames)
