"""The ball about what the cameras look at: where stereo looks while nothing is known of the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.views import Views


@dataclass(frozen=True)
class Region:
    """A ball about what the cameras look at: centre (3,), radius [units of the reconstruction]."""

    centre: np.ndarray
    radius: float

    def mask(self, views: Views, i: int) -> np.ndarray:
        """(h, w) uint8, 255 where view i sees the ball."""
        import cv2

        out = np.zeros((views.size[i, 1], views.size[i, 0]), np.uint8)
        camera = views.R[i] @ self.centre + views.t[i]
        if camera[2] > 0:
            u, v = (views.K[i] @ (camera / camera[2]))[:2]
            radius = views.K[i, 0, 0] * self.radius / camera[2]
            cv2.circle(out, (round(float(u)), round(float(v))), max(1, round(float(radius))), 255, -1)
        return out


def looked_at(centres: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Point nearest to all optical axes in the least-squares sense.

    Args:
        centres: (n, 3) camera centres.
        axes: (n, 3) unit viewing directions.
    """
    across = np.eye(3) - np.einsum("ni,nj->nij", axes, axes)
    return np.linalg.solve(across.sum(0) + 1e-9 * np.eye(3), np.einsum("nij,nj->i", across, centres))


def pixel_size(views: Views, region: Region) -> float:
    """Size of a pixel in the middle of the region, in the median view [units of the reconstruction]."""
    return float(np.median(np.linalg.norm(views.centres - region.centre, axis=1) / views.K[:, 0, 0]))


def region_of(views: Views) -> Region:
    """The ball about what the cameras look at that fills the images as far as their shorter side."""
    centre = looked_at(views.centres, views.R[:, 2])
    distance = np.linalg.norm(views.centres - centre, axis=1)
    return Region(centre, float(np.median(0.5 * views.size.min(1) / views.K[:, 0, 0] * distance)))
