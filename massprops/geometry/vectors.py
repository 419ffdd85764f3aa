"""Vectors of space: their cross product as a matrix, their directions, directions spread evenly, turns between axes."""

from __future__ import annotations

import numpy as np


def skew(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3) with skew(a) b = a x b; real or complex."""
    out = np.zeros((*v.shape, 3), v.dtype)
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def unit(v: np.ndarray) -> np.ndarray:
    """Vectors (..., k) of length one in the directions of v (..., k); zero stays zero."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-30))


def turn_deg(A: np.ndarray, B: np.ndarray) -> float:
    """Angle between two rotations A, B (3, 3) [deg]."""
    return float(np.degrees(np.arccos(np.clip((np.trace(A.T @ B) - 1) / 2, -1, 1))))


def angles_deg(v: np.ndarray) -> np.ndarray:
    """(n, n) angles between the directions of vectors (n, 3) [deg]."""
    sight = unit(v)
    return np.degrees(np.arccos(np.clip(sight @ sight.T, -1, 1)))


def sphere(count: int) -> np.ndarray:
    """(count, 3) directions spread evenly over the sphere (Fibonacci's spiral)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])


def turns_apart(R: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """(n,) angles between attitudes R and Q (n, 3, 3), body to camera, of one body whose axes differ by one turn [rad]."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(R.transpose(0, 2, 1) @ Q)
    return np.asarray((turns * turns.mean().inv()).magnitude())
