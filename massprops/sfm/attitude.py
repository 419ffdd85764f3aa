"""The sequence folder of a reconstruction: cameras, tracks, and the attitude history of a tumbling body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from massprops.core.text import counted
from massprops.sequence.data import AttitudeSeries, Camera, Environment, RangeSeries, Sequence, Tracks
from massprops.sfm.points import SparsePoints, residuals
from massprops.views import Views

SECOND = 1_000_000_000
"""[ns]."""


def quaternion(R: np.ndarray) -> np.ndarray:
    """(n, 4) Hamilton w x y z of rotation matrices (n, 3, 3), with the sign that keeps neighbours close."""
    from scipy.spatial.transform import Rotation

    q: np.ndarray = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
    if len(q):
        q[0] *= 1.0 if q[0, 0] >= 0 else -1.0
    for i in range(1, len(q)):
        if q[i] @ q[i - 1] < 0:
            q[i] = -q[i]
    return q


def clock(views: Views, index: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """(n,) timestamps [ns]; footage without a clock gets one image a second, by its place in the source.

    Args:
        index: (n,) place of each view in the source.
    """
    if len(views) and np.all(views.timestamp_ns >= 0):
        return views.timestamp_ns.astype(np.int64), []
    return index.astype(np.int64) * SECOND, [
        "the images have no clock: one image a second is assumed, so rates and times are in units of the image interval"
    ]


def one_camera(views: Views, own: np.ndarray) -> np.ndarray:
    """(n,) bool: of the views `own`, those with the commonest intrinsics and image size.

    A sequence has one set of intrinsics a camera; a folder of photographs may have several.
    """
    rows = np.column_stack([views.K.reshape(len(views), 9), views.distortion, views.size])[own]
    _, which, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    out = np.zeros(len(views), bool)
    out[np.flatnonzero(own)] = which.ravel() == np.argmax(count)
    return out


def camera_of(views: Views, own: np.ndarray, sigma_px: float, T_BS: np.ndarray | None) -> Camera:
    """`camN` from the first of its views."""
    i = int(np.flatnonzero(own)[0])
    K = views.K[i]
    return Camera(
        resolution=(int(views.size[i, 0]), int(views.size[i, 1])),
        intrinsics=np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]),
        distortion=views.distortion[i].copy(),
        T_BS=np.eye(4) if T_BS is None else T_BS,
        sigma_px=sigma_px,
    )


def as_pinhole(
    views: Views, points: SparsePoints, images: dict[str, Path] | None
) -> tuple[Views, SparsePoints, dict[str, Path] | None]:
    """Where a lens is a fisheye, which a sequence does not know: views without distortion, the observations where such
    cameras would have made them, and no images; else everything as it is."""
    import cv2

    if views.distortion.shape[1] == 4:
        return views, points, images
    uv = points.obs_uv.copy()
    for i in range(len(views)):
        of_view = points.obs_view == i
        if of_view.any():
            K, D = views.K[i], views.distortion[i]
            uv[of_view] = cv2.undistortPoints(np.ascontiguousarray(uv[of_view])[:, None], K, D, P=K)[:, 0]
    return replace(views, distortion=np.zeros((len(views), 4))), replace(points, obs_uv=uv), None


def to_sequence(
    views: Views,
    points: SparsePoints,
    index: np.ndarray,
    still: str | None,
    attitude_sigma: np.ndarray | None = None,
    mounting: dict[int, np.ndarray] | None = None,
    ranges: RangeSeries | None = None,
    environment: Environment | None = None,
    images: dict[str, Path] | None = None,
) -> Sequence:
    """Sequence of a reconstruction.

    The world of a tumbling body is the body, so the rotation of a view of cam0 is the attitude: it turns body vectors
    into the camera. Where a folder holds images of several cameras or zooms, tracks and images are those of the one
    with most images, and attitudes are of all.

    Args:
        index: (n,) place of each view in the source, for footage without a clock.
        still: why the body is no free one, in words; None for a tumbling body.
        attitude_sigma: (n,) [rad]; where it is absent or not finite, the residuals' angle stands in.
        mounting: (4, 4) T_BS by camera number.
        images: file of every view by name, or None; left out for a fisheye, whose tracks become a pinhole camera's.
    """
    views, points, images = as_pinhole(views, points, images)
    stamps, warnings = clock(views, index)
    number, error = _camera_numbers(views), residuals(views, points)
    cameras, tracked = {}, np.zeros(len(views), bool)
    for c in sorted(set(number.tolist())):
        of_camera = one_camera(views, number == c)
        tracked |= of_camera
        mine = error[of_camera[points.obs_view]]
        sigma = float(np.sqrt(np.mean(mine**2))) if len(mine) else 1.0
        files = [(int(stamps[i]), images[views.names[i]]) for i in np.flatnonzero(of_camera)] if images else []
        times = np.unique(stamps[of_camera])
        rate = float(SECOND / np.median(np.diff(times))) if len(times) > 1 else None
        camera = camera_of(views, of_camera, sigma, (mounting or {}).get(c))
        cameras[c] = replace(camera, rate_hz=rate, images=tuple(sorted(files)))
    order = np.lexsort((points.id[points.obs_point], number[points.obs_view], stamps[points.obs_view]))
    order = order[(_once(points, error) & tracked[points.obs_view])[order]]
    if not tracked.all():
        lost = counted(int(np.sum(~tracked)), "image has", "images have")
        warnings.append(f"{lost} no tracks in the sequence folder: another camera, zoom or orientation")
    v, p = points.obs_view[order], points.obs_point[order]
    tracks = Tracks(stamps[v], number[v], points.id[p], points.obs_uv[order])
    attitude = None
    if still is None:
        fallback = cameras[0].sigma_px / cameras[0].intrinsics[0] if 0 in cameras else 1e-3
        attitude = _attitudes(views, stamps, number == 0, attitude_sigma, fallback)
    else:  # its clock and tracks are of no use to anybody
        warnings = [f"{still}: no attitude history is written"]
    return Sequence(
        cameras=cameras,
        tracks=tracks,
        range=ranges,
        attitude=attitude,
        environment=environment or Environment(chaser_attitude="inertial"),
        warnings=tuple(warnings),
    )


def _camera_numbers(views: Views) -> np.ndarray:
    """(n,) N of each view's `camN`, 0 for a folder of images."""
    return np.array([int(n.split("/", 1)[0][3:]) if n.startswith("cam") else 0 for n in views.names], int)


def _attitudes(
    views: Views, stamps: np.ndarray, own: np.ndarray, given: np.ndarray | None, fallback: float
) -> AttitudeSeries:
    """Attitudes of the views `own` (n,) in time, one an instant, with sigmas given (n,) or, where absent, the fallback."""
    index = np.flatnonzero(own)
    index = index[np.argsort(stamps[index], kind="stable")]
    index = index[np.unique(stamps[index], return_index=True)[1]]
    sigma = np.full(len(views), fallback)
    if given is not None and len(given) == len(views):
        sigma = np.where(np.isfinite(given) & (given > 0), given, fallback)
    return AttitudeSeries(stamps[index], quaternion(views.R[index]), sigma[index])


def _once(points: SparsePoints, error: np.ndarray) -> np.ndarray:
    """(k,) bool: of several observations of one point in one image, the one that fits best."""
    key = points.obs_view.astype(np.int64) * (len(points.xyz) + 1) + points.obs_point
    order = np.lexsort((np.linalg.norm(error, axis=1), key))
    first = np.ones(len(key), bool)
    first[1:] = key[order][1:] != key[order][:-1]
    keep = np.zeros(len(key), bool)
    keep[order[first]] = True
    return keep
