"""Surface points that look at a camera, as it sees them."""

from __future__ import annotations

import numpy as np
from numba import njit


def facing_points(points: np.ndarray, normals: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Pixels and depths (k, 3) of those of n surface points that look at the camera and lie before it, in their order.

    Args:
        points: (n, 3) in the world; normals: (n, 3) outward.
        K: (3, 3) pinhole matrix [px]; R: (3, 3), t: (3,): world to camera, z forward.
    """
    seen = np.empty((len(points), 3))
    count = _facing(points, normals, np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]), R, t, seen)
    return seen[:count]


@njit(cache=True, error_model="numpy")
def _facing(
    points: np.ndarray, normals: np.ndarray, k: np.ndarray, R: np.ndarray, t: np.ndarray, seen: np.ndarray
) -> int:
    """How many rows of seen (n, 3) are written; points, normals: (n, 3); k: (4,) fx, fy, cx, cy [px]; R: (3, 3); t: (3,)."""
    n = 0
    for i in range(len(points)):
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
        y = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
        z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
        if not z > 0.0:
            continue
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        p = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c
        q = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c
        r = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c
        if p * x + q * y + r * z < 0.0:
            seen[n, 0], seen[n, 1], seen[n, 2] = k[0] * x / z + k[2], k[1] * y / z + k[3], z
            n += 1
    return n
