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
