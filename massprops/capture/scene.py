"""The points of a region among which an object is looked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dense.region import Region
from massprops.geometry.projection import project
from massprops.views import Views


@dataclass(frozen=True)
class Scene:
    """Dense points of the region: xyz, normal (n, 3), rgb (n, 3) uint8; the views and their region; size of a pixel at
    the object [units of the reconstruction]."""

    xyz: np.ndarray
    normal: np.ndarray
    rgb: np.ndarray
    views: Views
    region: Region
    pixel: float


def seen_in(scene: Scene, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and depths (n,) of all points in one view; NaN behind the camera."""
    v = scene.views
    uv, z = project(scene.xyz, v.K[view], v.R[view], v.t[view])
    ahead = z > 1e-9
    return np.where(ahead[:, None], uv, np.nan), np.where(ahead, z, np.nan)
