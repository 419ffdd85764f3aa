"""The photographs' colours on the vertices of a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from massprops.geometry.interpolation import bilinear
from massprops.geometry.projection import project
from massprops.geometry.rasterise import rasterise
from massprops.surface.refine import vertex_normals
from massprops.views import Views

HIDDEN = 0.01
"""A vertex this much farther than the surface before it, relative to its depth, is hidden."""
ENOUGH_VIEWS = 75
"""Views from which on only every second is asked, of twice as many, and so on: neighbours in a film show the same."""
LEAST_FACING = 0.2
"""Cosine between a vertex's normal and the line of sight below which a view says nothing of its colour."""


def vertex_colours(
    vertices: np.ndarray, faces: np.ndarray, views: Views, image: Callable[[int], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Colours blended over the views that see each vertex, or some of many; those that face it most count most.

    Args:
        vertices: (v, 3); faces: (f, 3).
        views: n views.
        image: `image(i)` gives view i undistorted, (h, w, 3) uint8 BGR.

    Returns:
        (v, 3) uint8 RGB, those of unseen vertices taken from the nearest seen one; (v,) bool, which were seen.
    """
    from scipy.spatial import cKDTree

    normal = vertex_normals(vertices, faces)
    total, weight = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for i in range(0, len(views), max(1, len(views) // ENOUGH_VIEWS)):
        K, R, t = views.K[i], views.R[i], views.t[i]
        picture = image(i)
        h, w = picture.shape[:2]
        depth, _ = rasterise(vertices, faces, K, R, t, (w, h))
        sight = views.centres[i] - vertices
        facing = np.einsum("ij,ij->i", normal, sight) / np.maximum(np.linalg.norm(sight, axis=1), 1e-12)
        uv, z = project(vertices, K, R, t)
        inside = (uv[:, 0] > 0.5) & (uv[:, 1] > 0.5) & (uv[:, 0] < w - 1.5) & (uv[:, 1] < h - 1.5)
        use = np.flatnonzero(inside & (z > 1e-9) & (facing > LEAST_FACING))
        j, k = np.rint(uv[use]).astype(int).T
        use = use[z[use] < (1 + HIDDEN) * depth[k, j]]
        if not len(use):
            continue
        share = facing[use] ** 2
        total[use] += share[:, None] * bilinear(picture, uv[use])
        weight[use] += share
    seen = weight > 0
    out = np.full((len(vertices), 3), 128.0)
    out[seen] = total[seen] / weight[seen, None]
    if seen.any() and not seen.all():
        out[~seen] = out[seen][cKDTree(vertices[seen]).query(vertices[~seen])[1]]
    return np.clip(np.rint(out[:, ::-1]), 0, 255).astype(np.uint8), seen
