"""A body placed by attitudes that were given: its outlines tell where it is, and no feature is asked for.

A plain body has nothing to match. Where another sensor knows its attitude (`attitude0`), the path of its centre of mass is all that
is missing (`massprops.sfm.outline_path`).
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace

import numpy as np
import pycolmap

from massprops.core.inputs import read_image
from massprops.core.text import counted
from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, rotation_matrix, rotation_vector
from massprops.errors import NotPossible
from massprops.sequence.data import AttitudeSeries
from massprops.sfm.convert import HALF
from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord
from massprops.sfm.outline_path import OutlinePath, outline_path
from massprops.views import Views, undistort

FEWEST = 8
"""Images with an attitude without which no path is fitted: five numbers, and each image needs others that turn away from it."""
LEAST_LIT = 100
"""Pixels of a silhouette of fewer than which its outline says nothing."""
LONGEST_TURN = 30.0
"""Turn between two neighbours of the series [degree] beyond which nothing is interpolated."""


@dataclass(frozen=True)
class GivenPoses:
    """The images of cam0 that have an attitude, placed: `views`, as a COLMAP `model` without points; sigma (n,) of their attitudes
    [rad], the `path` on which the body moves, and `warnings`."""

    views: Views
    model: pycolmap.Reconstruction
    sigma: np.ndarray
    path: OutlinePath
    warnings: tuple[str, ...]


def place_by_attitudes(footage: FootageRecord, given: AttitudeSeries, seed: int) -> GivenPoses:
    """Places the images of a body that moves freely before a still camera.

    Raises:
        NotPossible: no focal length, no silhouettes or too few attitudes are known, or they do not fit the outlines.
    """
    camera = footage.cameras[0]
    if camera.focal_px is None:
        raise NotPossible("attitudes alone do not tell a focal length: give --focal, or cam0/sensor.yaml")
    of_camera = [f for f in footage.frames if f.camera == camera.id]
    frames = [f for f in of_camera if f.timestamp_ns >= 0 and footage.mask(f.name).is_file()]
    silhouettes = [read_image(footage.mask(f.name), 0) for f in frames]
    R, sigma = attitudes_at(given, np.array([f.timestamp_ns for f in frames], np.int64))
    lit = np.array([np.count_nonzero(m == 255) >= LEAST_LIT for m in silhouettes], bool)
    of_kept = np.flatnonzero(np.isfinite(sigma) & lit)
    kept, silhouettes = [frames[i] for i in of_kept], [silhouettes[i] for i in of_kept]
    if len(kept) < FEWEST:
        raise NotPossible(
            f"attitude0 covers {len(kept)} of the {len(of_camera)} images: both must use one clock, and at least "
            f"{FEWEST} are needed"
        )
    sigma, unplaced = sigma[of_kept], _views(footage, camera, kept, R[of_kept])
    K, distortion = unplaced.K[0], unplaced.distortion[0]
    grey = [undistort(read_image(footage.image(f.name), 0), K, distortion) for f in kept]
    masks = [undistort(m, K, distortion, nearest=True) for m in silhouettes]
    time = 1e-9 * (unplaced.timestamp_ns - unplaced.timestamp_ns[0])
    path = outline_path(unplaced, masks, grey, time, float(np.median(sigma)), seed)
    views = replace(unplaced, t=path.position)
    missing = len(of_camera) - len(kept)
    lines = (
        [counted(missing, "image has", "images have") + " no attitude in attitude0 or no outline: left out"]
        if missing
        else []
    )
    return GivenPoses(views, _model(views), sigma, path, tuple(lines))


def attitudes_at(given: AttitudeSeries, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes at times (n,) [ns], interpolated along the shortest turn.

    Returns:
        (n, 3, 3) rotations of body vectors into the camera, and (n,) their 1-sigma [rad]; not a number before the first, after the
        last, and between neighbours that are more than `LONGEST_TURN` apart.
    """
    order = np.argsort(given.timestamp_ns, kind="stable")
    stamp = given.timestamp_ns[order].astype(np.int64)
    if len(stamp) < 2:
        return np.tile(np.eye(3), (len(times), 1, 1)), np.full(len(times), np.nan)
    after = np.clip(np.searchsorted(stamp, times), 1, len(stamp) - 1)
    before = after - 1
    share = (times - stamp[before]) / np.maximum(stamp[after] - stamp[before], 1)
    earlier, later = given.q[order][before], given.q[order][after]
    step = rotation_vector(multiply(conjugate(earlier), later))
    R = rotation_matrix(multiply(earlier, from_rotation_vector(np.clip(share, 0, 1)[:, None] * step)))
    sigma = np.maximum(given.sigma[order][before], given.sigma[order][after])
    known = (times >= stamp[0]) & (times <= stamp[-1]) & (np.linalg.norm(step, axis=1) <= np.radians(LONGEST_TURN))
    exact = np.isin(times, stamp)
    return R, np.where(known | exact, sigma, np.nan)


def _views(footage: FootageRecord, camera: CameraRecord, frames: list[FrameRecord], R: np.ndarray) -> Views:
    """The images with their attitudes (n, 3, 3); where the body is stays open."""
    n, (w, h) = len(frames), camera.size
    u, v = camera.principal_point or ((w - 1) / 2, (h - 1) / 2)
    K = np.array([[camera.focal_px, 0, u], [0, camera.focal_px, v], [0, 0, 1.0]])
    return Views(
        names=tuple(f.name for f in frames),
        timestamp_ns=np.array([f.timestamp_ns for f in frames], np.int64),
        size=np.array([footage.size(f) for f in frames]),
        K=np.tile(K, (n, 1, 1)),
        distortion=np.tile(np.zeros(4) if camera.distortion is None else np.array(camera.distortion, float), (n, 1)),
        R=R,
        t=np.zeros((n, 3)),
    )


def _model(views: Views) -> pycolmap.Reconstruction:
    """The same as COLMAP knows it, without points."""
    out = pycolmap.Reconstruction()
    K, distortion = views.K[0], views.distortion[0]
    params = [K[0, 0], K[1, 1], K[0, 2] + HALF, K[1, 2] + HALF, *distortion]
    w, h = (int(s) for s in views.size[0])
    out.add_camera_with_trivial_rig(pycolmap.Camera(model="OPENCV", width=w, height=h, params=params, camera_id=1))
    for i, name in enumerate(views.names):
        image = pycolmap.Image(name=name, camera_id=1, image_id=i + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(views.R[i]), views.t[i])
        out.add_image_with_trivial_frame(image, pose)
    return out
