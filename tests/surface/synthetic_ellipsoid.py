"""An ellipsoid about the origin as cameras see it, and meshes of it."""

from __future__ import annotations

import numpy as np
import trimesh

from massprops.surface.cloud import Cloud
from massprops.views import Views


def seen(
    views: Views, i: int, axes: np.ndarray, size: tuple[int, int], finer: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Of every pixel of view i, whether it shows the ellipsoid (h, w) bool, and which place of it (h, w, 3).

    Args:
        axes: (3,) half axes; size: width, height of the image; finer: samples along a pixel, then (finer h, finer w) of either.
    """
    at = [(np.arange(finer * n) + 0.5) / finer - 0.5 for n in size]
    u, v = np.meshgrid(*at)
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1)
    ray = (pixels @ np.linalg.inv(views.K[i]).T @ views.R[i]) / axes
    eye = views.centres[i] / axes
    a, b, c = (ray**2).sum(-1), ray @ eye, eye @ eye - 1
    hit = b**2 > a * c
    return hit, (eye + ((-b - np.sqrt(np.where(hit, b**2 - a * c, 0))) / a)[..., None] * ray) * axes


def mesh_off(axes: np.ndarray, outward: float, sigma: float) -> tuple[np.ndarray, np.ndarray, Cloud]:
    """Vertices (v, 3) so far `outward` of the ellipsoid, faces (f, 3), and the vertices as a cloud of points, one a view."""
    mesh = trimesh.creation.icosphere(5, 1.0)
    vertices, faces = np.asarray(mesh.vertices) * axes, np.asarray(mesh.faces)
    normal = vertices / axes**2
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    vertices = vertices + outward * normal
    count = len(vertices)
    cloud = Cloud(vertices, normal, np.full(count, sigma), np.arange(count + 1), np.zeros(count, int))
    return vertices, faces, cloud


def height_over(vertices: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(v,) how far places lie outside the ellipsoid, to first order."""
    return (((vertices / axes) ** 2).sum(1) - 1) / (2 * np.linalg.norm(vertices / axes**2, axis=1))
