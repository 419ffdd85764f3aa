"""Epipolar geometry of two views (Hartley and Zisserman 2004, chapters 9 and 11)."""

from __future__ import annotations

import numpy as np

from massprops.geometry.vectors import skew


def sampson(F: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(k,) distance of matches from a fundamental matrix to first order (eq. 11.9) [px].

    Args:
        F: (3, 3), y^T F x = 0.
        x, y: (k, 3) homogeneous pixels of the first and the second view, the last coordinate 1.
    """
    Fx, Fy = x @ F.T, y @ F
    size = np.sqrt(Fx[:, 0] ** 2 + Fx[:, 1] ** 2 + Fy[:, 0] ** 2 + Fy[:, 1] ** 2)
    return np.asarray(np.abs(np.einsum("ki,ki->k", y, Fx)) / np.maximum(size, 1e-300))


def fundamental(
    K: tuple[np.ndarray, np.ndarray], R: tuple[np.ndarray, np.ndarray], t: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """(3, 3) fundamental matrix of two posed views: intrinsics (3, 3), and poses (3, 3), (3,) from world to camera."""
    turn = R[1] @ R[0].T
    cross = skew(t[1] - turn @ t[0])
    return np.asarray(np.linalg.inv(K[1]).T @ cross @ turn @ np.linalg.inv(K[0]))
