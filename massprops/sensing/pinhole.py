"""Pinhole cameras on the chaser: where a point of the target appears, and how that depends on the point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.sequence.data import Camera


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion.

    Attributes:
        intrinsics: (4,) fu, fv, cu, cv [px].
        R: (3, 3) and t: (3,): a point X of the chaser's frame (cam0 at rest) is R (X - t) in the camera [m].
        height: image height [px], for what depends on the row.
    """

    intrinsics: np.ndarray
    R: np.ndarray
    t: np.ndarray
    height: int = 0


def pinhole_of(camera: Camera, first: Camera) -> Pinhole:
    """`camera` seen from the frame of `first` (cam0)."""
    pose = np.linalg.inv(first.T_BS) @ camera.T_BS
    return Pinhole(np.asarray(camera.intrinsics, float), pose[:3, :3].T, pose[:3, 3], camera.resolution[1])


def project(camera: Pinhole, X: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points X (..., 3) in the chaser's frame; complex-step safe. NaN behind the camera."""
    fu, fv, cu, cv = camera.intrinsics
    Y = (X - camera.t) @ camera.R.T
    depth = np.where(np.real(Y[..., 2]) > 0, Y[..., 2], np.nan)
    return np.stack([fu * Y[..., 0] / depth + cu, fv * Y[..., 1] / depth + cv], axis=-1)


def at_depth(
    camera: Pinhole, uv: np.ndarray, depth: np.ndarray, sigma_px: float, along: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points (..., 3) of the chaser's frame at a believed depth on the rays of pixels (..., 2), and covariance (..., 3, 3).

    Args:
        depth: (...) [m]; sigma_px: 1-sigma of a pixel; along: of the depth [m].
    """
    slopes = (uv - camera.intrinsics[2:]) / camera.intrinsics[:2]
    ray = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
    lever = np.zeros((*ray.shape, 3))
    lever[..., 0, 0], lever[..., 1, 1] = depth / camera.intrinsics[0], depth / camera.intrinsics[1]
    lever[..., :, 2] = ray
    lever = camera.R.T @ lever * np.array([sigma_px, sigma_px, along])
    return (ray * depth[..., None]) @ camera.R + camera.t, lever @ np.swapaxes(lever, -1, -2)
