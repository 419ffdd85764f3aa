"""What lies in the shadow of a surface itself, far from its Sun."""

from __future__ import annotations

import numpy as np

from massprops.geometry.rasterise import rasterise

SHADOW_SIZE = 600
"""Side of the map of what the Sun sees [px]."""
IN_SHADOW = 3.0
"""Depth behind what the Sun sees first, in edges of the mesh, from which a place is in its shadow."""


def behind_first(vertices: np.ndarray, faces: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(v,) how far each vertex lies behind what is seen first from very far in a direction (3,)."""
    ray = -towards / np.linalg.norm(towards)
    side = np.linalg.svd(ray[None])[2][1]
    R = np.stack([side, np.cross(ray, side), ray])
    middle = vertices.mean(axis=0)
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    far, half = 200.0 * radius, SHADOW_SIZE / 2
    K = np.array([[0.95 * half * far / radius, 0, half], [0, 0.95 * half * far / radius, half], [0, 0, 1.0]])
    t = np.array([0.0, 0.0, far]) - R @ middle
    depth = rasterise(vertices, faces, K, R, t, (SHADOW_SIZE, SHADOW_SIZE))[0]
    camera = vertices @ R.T + t
    at = np.clip(np.rint((camera @ K.T)[:, :2] / camera[:, 2:]).astype(int), 0, SHADOW_SIZE - 1)
    return camera[:, 2] - depth[at[:, 1], at[:, 0]]
