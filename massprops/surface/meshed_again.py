"""A closed mesh made again with faces of one size, by its signed distance on a regular grid.

A surface that is moved along its normals crowds its vertices where it is hollow, and at last folds over itself. Meshed again between moves it
does neither: only what lies within is kept, not how it was cut into faces.
"""

from __future__ import annotations

import numpy as np

from massprops.native import ray_scene
from massprops.surface.level_set import level_set

RAYS = 5
"""Rays that say whether a place is within, by majority: an odd number."""


def meshed_again(vertices: np.ndarray, faces: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (w, 3) and faces (g, 3) of the same body, its largest details that a grid of a `step` [world units] shows.

    Args:
        vertices: (v, 3); faces: (f, 3), closed.
    """
    low, high = vertices.min(axis=0) - 3 * step, vertices.max(axis=0) + 3 * step
    size = np.ceil((high - low) / step).astype(int) + 1
    place = low + step * np.stack(np.meshgrid(*(np.arange(n) for n in size), indexing="ij"), axis=-1)
    away = ray_scene((vertices, faces)).compute_signed_distance(place.reshape(-1, 3).astype(np.float32), nsamples=RAYS)
    return level_set(away.numpy().reshape(size).astype(float), low, step)
