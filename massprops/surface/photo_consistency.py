"""What the photographs of one placement show where the points of another would lie.

Two placements of a body may have next to no measured surface in common: of a plate that leaned on its handle stereo
measured one face only, and its rims in the other placement alone. But its photographs show the rims all the same. Laid by
the right turn, they show the points' own paint there; by a wrong one, another's, or none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.geometry.projection import pixels_of
from massprops.geometry.rasterise import rasterise
from massprops.surface.cloud import Cloud
from massprops.views import Views

LONGEST = 700
"""Longer side to which photographs are reduced [px]: paint is compared over some pixels of the first shapes' errors."""
FACING = 0.35
"""Cosine between surface and line of sight below which a photograph does not say what is painted there."""
DEEPER = 4.0
"""A point this many pixels behind the shapes is hidden by them."""
SMOOTH = 0.7
"""Blur of the reduced photographs [px]."""


@dataclass(frozen=True)
class Photographs:
    """Photographs of one placement, and its first shape.

    Attributes:
        K: n camera matrices (3, 3), R: (n, 3, 3) and t: (n, 3) world to camera.
        images: n arrays (h, w, 3) uint8 RGB; masks: n silhouettes (h, w) uint8.
        vertices: (v, 3); faces: (f, 3).
    """

    K: list[np.ndarray]
    R: np.ndarray
    t: np.ndarray
    images: list[np.ndarray]
    masks: list[np.ndarray]
    vertices: np.ndarray
    faces: np.ndarray

    def paint(
        self, cloud: Cloud, vertices: np.ndarray, faces: np.ndarray, R: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Colours (n, 3) of another placement's points, where they are carried by R x + t, and (n,) bool which are shown.

        Each comes from the photograph that sees its surface least obliquely.

        Args:
            cloud: the points; vertices, faces: first shape of their placement, which hides what lies behind it.
        """
        x, normal, hides = cloud.xyz @ R.T + t, cloud.normal @ R.T, vertices @ R.T + t
        best, colour = np.full(len(x), FACING), np.zeros((len(x), 3))
        for i, (image, mask) in enumerate(zip(self.images, self.masks, strict=True)):
            h, w = mask.shape
            view = self.K[i], self.R[i], self.t[i], (w, h)
            depth = np.minimum(rasterise(hides, faces, *view)[0], rasterise(self.vertices, self.faces, *view)[0])
            there, v, u = pixels_of(x, *view[:3], mask.shape)
            z = x[there] @ self.R[i, 2] + self.t[i, 2]
            sight = -self.R[i].T @ self.t[i] - x[there]
            facing = np.einsum("ij,ij->i", sight, normal[there]) / np.linalg.norm(sight, axis=1)
            near = z < depth[v, u] + DEEPER * z / self.K[i][0, 0]
            shown = near & (facing > best[there]) & (mask[v, u] == 255)
            use = there[shown]
            colour[use], best[use] = image[v[shown], u[shown]], facing[shown]
        return colour, best > FACING


def photographs(
    views: Views, images: list[np.ndarray], masks: list[np.ndarray], vertices: np.ndarray, faces: np.ndarray
) -> Photographs:
    """Photographs as points of another placement are looked for in them.

    Args:
        views: n cameras; images: n arrays (h, w, 3) uint8 RGB, masks: n silhouettes (h, w) uint8, all undistorted.
        vertices, faces: first shape of the placement.
    """
    import cv2

    K, small, known = [], [], []
    for i, (image, mask) in enumerate(zip(images, masks, strict=True)):
        h, w = mask.shape
        factor = min(1.0, LONGEST / max(h, w))
        size = (round(w * factor), round(h * factor))
        scale = np.array([size[0] / w, size[1] / h])
        camera_matrix = views.K[i].copy()
        camera_matrix[:2] *= scale[:, None]
        camera_matrix[:2, 2] += 0.5 * scale - 0.5
        K.append(camera_matrix)
        small.append(cv2.GaussianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), (0, 0), SMOOTH))
        known.append(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST))
    return Photographs(K, views.R, views.t, small, known, vertices, faces)
