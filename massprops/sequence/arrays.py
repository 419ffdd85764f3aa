"""A sequence from a user's own arrays: tracks, attitudes, body rates, ranges."""

from __future__ import annotations

from collections.abc import Sequence as Listing
from pathlib import Path

import numpy as np

from massprops.errors import InputError
from massprops.sequence.data import AttitudeSeries, Camera, Environment, RangeSeries, RateSeries, Sequence, Tracks
from massprops.sequence.write import write_sequence


def sequence_from_arrays(
    times: np.ndarray,
    *,
    tracks: np.ndarray | None = None,
    camera_matrix: np.ndarray | None = None,
    size: tuple[int, int] | None = None,
    distortion: Listing[float] = (0.0, 0.0, 0.0, 0.0),
    baseline: float = 0.0,
    sigma_px: float | None = None,
    attitude: np.ndarray | None = None,
    attitude_sigma: float = 0.01,
    rates: np.ndarray | None = None,
    rate_sigma: float | None = None,
    ranges: np.ndarray | None = None,
    range_sigma: float | None = None,
    environment: Environment | None = None,
    out: str | Path | None = None,
) -> Sequence:
    """See `massprops.sequence_from_arrays`, which says what each argument is."""
    stamp = _stamps(times)
    n = len(stamp)
    if all(x is None for x in (tracks, attitude, rates)):
        raise InputError("nothing measured: give tracks, attitude or rates")
    cameras, seen = {}, None
    if tracks is not None:
        uv = np.asarray(tracks, float)
        uv = uv[None] if uv.ndim == 3 else uv
        if uv.ndim != 4 or uv.shape[0] not in (1, 2) or uv.shape[1] != n or uv.shape[3] != 2:
            raise InputError(f"tracks of shape {np.shape(tracks)}: give ({n}, m, 2), or (2, {n}, m, 2) for stereo")
        if camera_matrix is None or size is None:
            raise InputError("tracks need camera_matrix, (3, 3) in pixels, and size, (width, height)")
        if len(uv) == 2 and not baseline > 0:
            raise InputError("tracks of two cameras need baseline, the distance between them in metres")
        cameras = {k: _camera(camera_matrix, size, distortion, k * baseline, sigma_px) for k in range(len(uv))}
        camera, epoch, feature = np.nonzero(np.isfinite(uv).all(axis=3))
        order = np.lexsort((feature, camera, epoch))
        camera, epoch, feature = camera[order], epoch[order], feature[order]
        seen = Tracks(stamp[epoch], camera, feature, uv[camera, epoch, feature])
    sequence = Sequence(
        cameras=cameras,
        tracks=seen,
        range=None if ranges is None else RangeSeries(stamp, _shaped("ranges", ranges, (n,)), range_sigma),
        rates=None if rates is None else RateSeries(stamp, _shaped("rates", rates, (n, 3)), rate_sigma),
        attitude=None if attitude is None else _attitudes(stamp, attitude, attitude_sigma),
        environment=environment or Environment(),
    )
    if out is not None:
        write_sequence(out, sequence)
    return sequence


def _stamps(times: np.ndarray) -> np.ndarray:
    times = np.asarray(times, float)
    if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0):
        raise InputError("times: give (n,) seconds, finite and increasing, two or more")
    return np.round(times * 1e9).astype(np.int64)


def _shaped(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    values = np.asarray(values, float)
    if values.shape != shape or not np.isfinite(values).all():
        raise InputError(f"{name} of shape {values.shape}: give finite numbers of shape {shape}, one row a time")
    return values


def _attitudes(stamp: np.ndarray, q: np.ndarray, sigma: float) -> AttitudeSeries:
    q = _shaped("attitude", q, (len(stamp), 4))
    length = np.linalg.norm(q, axis=1)
    if np.any(np.abs(length - 1) > 1e-3):
        raise InputError("attitude: quaternions must have length 1, scalar first")
    return AttitudeSeries(stamp, q / length[:, None], np.full(len(stamp), float(sigma)))


def _camera(
    matrix: np.ndarray, size: tuple[int, int], distortion: Listing[float], right_m: float, sigma_px: float | None
) -> Camera:
    K = _shaped("camera_matrix", matrix, (3, 3))
    pose = np.eye(4)
    pose[0, 3] = right_m
    return Camera(
        resolution=(int(size[0]), int(size[1])),
        intrinsics=np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]),
        distortion=np.asarray(distortion, float),
        T_BS=pose,
        sigma_px=sigma_px,
    )
