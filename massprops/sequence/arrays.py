"""A sequence from a user's own arrays: tracks, attitudes, body rates, ranges."""

from __future__ import annotations

from collections.abc import Sequence as Listing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from massprops.errors import InputError
from massprops.sequence.data import AttitudeSeries, Camera, Environment, RangeSeries, RateSeries, Sequence, Tracks
from massprops.sequence.write import write_sequence


@dataclass(frozen=True)
class Pixels:
    """What one camera or a pair saw, as `massprops.sequence_from_arrays` says it: tracks (n, m, 2) or (2, n, m, 2) [px],
    camera_matrix (3, 3), size, distortion k1, k2, p1, p2, baseline [m], sigma_px."""

    tracks: np.ndarray | None
    camera_matrix: np.ndarray | None
    size: tuple[int, int] | None
    distortion: Listing[float]
    baseline: float
    sigma_px: float | None

    def of_times(self, stamp: np.ndarray) -> tuple[dict[int, Camera], Tracks | None]:
        """Cameras and tracks at these times (n,)."""
        if self.tracks is None:
            return {}, None
        n, uv = len(stamp), np.asarray(self.tracks, float)
        uv = uv[None] if uv.ndim == 3 else uv
        if uv.ndim != 4 or uv.shape[0] not in (1, 2) or uv.shape[1] != n or uv.shape[3] != 2:
            raise InputError(f"tracks of shape {np.shape(self.tracks)}: give ({n}, m, 2), or (2, {n}, m, 2) for stereo")
        if self.camera_matrix is None or self.size is None:
            raise InputError("tracks need camera_matrix, (3, 3) in pixels, and size, (width, height)")
        if len(uv) == 2 and not self.baseline > 0:
            raise InputError("tracks of two cameras need baseline, the distance between them in metres")
        camera, epoch, feature = np.nonzero(np.isfinite(uv).all(axis=3))
        order = np.lexsort((feature, camera, epoch))
        camera, epoch, feature = camera[order], epoch[order], feature[order]
        cameras = {k: self._camera(k * self.baseline) for k in range(len(uv))}
        return cameras, Tracks(stamp[epoch], camera, feature, uv[camera, epoch, feature])

    def _camera(self, right_m: float) -> Camera:
        K = _shaped("camera_matrix", self.camera_matrix, (3, 3))
        pose = np.eye(4)
        pose[0, 3] = right_m
        width, height = self.size or (0, 0)
        return Camera(
            resolution=(int(width), int(height)),
            intrinsics=np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]),
            distortion=np.asarray(self.distortion, float),
            T_BS=pose,
            sigma_px=self.sigma_px,
        )


class Noisy(NamedTuple):
    """Measured values, one row a time, and their 1-sigma; None where there are none."""

    values: np.ndarray | None
    sigma: float | None


def sequence_of(
    times: np.ndarray,
    pixels: Pixels,
    attitude: Noisy,
    rates: Noisy,
    ranges: Noisy,
    environment: Environment | None,
    out: Path | None,
) -> Sequence:
    """The sequence of `massprops.sequence_from_arrays`, where the arguments are described; written to `out` if given.

    Raises:
        InputError: shapes that do not fit together, or nothing measured.
    """
    stamp = _stamps(times)
    n = len(stamp)
    if all(x is None for x in (pixels.tracks, attitude.values, rates.values)):
        raise InputError("nothing measured: give tracks, attitude or rates")
    cameras, seen = pixels.of_times(stamp)
    sequence = Sequence(
        cameras=cameras,
        tracks=seen,
        range=None
        if ranges.values is None
        else RangeSeries(stamp, _shaped("ranges", ranges.values, (n,)), ranges.sigma),
        rates=None if rates.values is None else RateSeries(stamp, _shaped("rates", rates.values, (n, 3)), rates.sigma),
        attitude=None if attitude.values is None else _attitudes(stamp, attitude.values, attitude.sigma),
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


def _shaped(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(values, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{name} of shape {array.shape}: give finite numbers of shape {shape}, one row a time")
    return array


def _attitudes(stamp: np.ndarray, q: np.ndarray, sigma: Any) -> AttitudeSeries:
    q = _shaped("attitude", q, (len(stamp), 4))
    length = np.linalg.norm(q, axis=1)
    if np.any(np.abs(length - 1) > 1e-3):
        raise InputError("attitude: quaternions must have length 1, scalar first")
    return AttitudeSeries(stamp, q / length[:, None], np.full(len(stamp), float(sigma)))
