"""Points as an undistorted pinhole camera sees them."""

from __future__ import annotations

import numpy as np


def project(points: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and depths (n,) of world points (n, 3) in one undistorted pinhole view."""
    camera = points @ R.T + t
    depth = camera[:, 2]
    safe = np.where(depth > 1e-9, depth, 1.0)
    uv = (camera[:, :2] / safe[:, None]) @ K[:2, :2].T + K[:2, 2]
    return uv, depth


def on_pixels(uv: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which of some places (n, 2) lie in an image (h, w): (k,) their numbers, and the rows and columns (k,) of their pixels."""
    at = np.rint(uv)
    x, y = at.T  # a column at a time, as pairs are slow to ask
    index = np.flatnonzero((x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0]))
    columns, rows = at[index].astype(int).T
    return index, rows, columns


def pixels_of(
    points: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `on_pixels`, of world points (n, 3) before one undistorted pinhole view."""
    uv, depth = project(points, K, R, t)
    return on_pixels(np.where((depth > 1e-9)[:, None], uv, -1.0), shape)


def intrinsics(K: np.ndarray) -> np.ndarray:
    """Focal lengths and principal point (n, 4), fu fv cu cv, of camera matrices (n, 3, 3) [px]."""
    return np.stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2]], axis=1)


def camera_rows(K: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Cameras as compiled loops take them (n, 16): fu fv cu cv, the rotation row by row, the translation.

    Args:
        K: (n, 3, 3) pinhole matrices [px]; R: (n, 3, 3), t: (n, 3): to the camera.
    """
    return np.concatenate([intrinsics(K), R.reshape(-1, 9), t], axis=1)
