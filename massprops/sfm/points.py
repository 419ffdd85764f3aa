"""Sparse points with their observations, and the projection that made them; nothing here needs pycolmap."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.views import Views


@dataclass(frozen=True)
class SparsePoints:
    """m points and their k observations.

    Attributes:
        id: (m,) int64, COLMAP's point numbers.
        xyz: (m, 3) in the world of the reconstruction.
        rgb: (m, 3) uint8.
        error: (m,) mean reprojection error [px].
        obs_view: (k,) index into the views.
        obs_point: (k,) index into the points.
        obs_uv: (k, 2) in the original image, centres of pixels at whole numbers [px].
    """

    id: np.ndarray
    xyz: np.ndarray
    rgb: np.ndarray
    error: np.ndarray
    obs_view: np.ndarray
    obs_point: np.ndarray
    obs_uv: np.ndarray

    def save(self, path: Path) -> None:
        """Writes one `.npz`."""
        np.savez(path, **{k: getattr(self, k) for k in self.__dataclass_fields__})

    @staticmethod
    def load(path: Path) -> SparsePoints:
        """Reads what `save` wrote."""
        with open_arrays(path) as z:
            return SparsePoints(**{k: z[k] for k in SparsePoints.__dataclass_fields__})

    def observed(self, keep: np.ndarray) -> SparsePoints:
        """The observations at `keep` (k,) bool, and the points that still have one."""
        point, number = np.unique(self.obs_point[keep], return_inverse=True)
        return SparsePoints(
            self.id[point],
            self.xyz[point],
            self.rgb[point],
            self.error[point],
            self.obs_view[keep],
            number.astype(self.obs_point.dtype),
            self.obs_uv[keep],
        )

    @staticmethod
    def filling(centre: np.ndarray, radius: float) -> SparsePoints:
        """200 points drawn evenly in the ball about `centre` (3,), which no view observed."""
        rng, count = np.random.default_rng([0, 29]), 200
        way = rng.standard_normal((count, 3))
        way *= (radius * rng.random(count) ** (1 / 3) / np.linalg.norm(way, axis=1))[:, None]
        return replace(
            SparsePoints.none(),
            id=np.arange(count),
            xyz=centre + way,
            rgb=np.zeros((count, 3), np.uint8),
            error=np.zeros(count),
        )

    @staticmethod
    def none() -> SparsePoints:
        """No points."""
        unseen = np.zeros(0, np.int32)
        return SparsePoints(
            np.zeros(0, np.int64),
            np.zeros((0, 3)),
            np.zeros((0, 3), np.uint8),
            np.zeros(0),
            unseen,
            unseen,
            np.zeros((0, 2)),
        )

    def near(self, centre: np.ndarray, radius: float) -> SparsePoints:
        """Points within `radius` of `centre` (3,), with their observations."""
        return self.observed((np.linalg.norm(self.xyz - centre, axis=1) < radius)[self.obs_point])

    def of_views(self, index: np.ndarray) -> SparsePoints:
        """What the views at `index` (integers) saw; views are numbered anew in that order."""
        place = np.full(int(max(self.obs_view.max(initial=-1), index.max(initial=-1))) + 1, -1)
        place[index] = np.arange(len(index))
        kept = self.observed(place[self.obs_view] >= 0)
        return replace(kept, obs_view=place[kept.obs_view].astype(kept.obs_view.dtype))

    def moved(self, R: np.ndarray, t: np.ndarray, views: int) -> SparsePoints:
        """The points at R x + t, R (3, 3), t (3,), their views numbered from `views` on."""
        return replace(self, xyz=self.xyz @ R.T + t, obs_view=self.obs_view + views)

    @staticmethod
    def joined(parts: list[SparsePoints]) -> SparsePoints:
        """All points of several sets whose views are numbered on; a point of two sets counts as two."""
        begin = np.cumsum([0, *(len(p.xyz) for p in parts)])[:-1]
        parts = [replace(p, obs_point=p.obs_point + b) for p, b in zip(parts, begin, strict=True)]
        return SparsePoints(
            *(np.concatenate([getattr(p, k) for p in parts]) for k in SparsePoints.__dataclass_fields__)
        )


def project(K: np.ndarray, distortion: np.ndarray, R: np.ndarray, t: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """Pixels (m, 2) of world points (m, 3), one camera per point: K (m, 3, 3), distortion (m, 4 or 8), R (m, 3, 3),
    t (m, 3).

    OpenCV's radial-tangential model, or its rational one.
    """
    c = np.einsum("mij,mj->mi", R, xyz) + t
    return project_camera(K, distortion, c)


def projected(views: Views, v: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """Pixels (m, 2) of world points (m, 3), each in the view v (m,) as it was taken."""
    return project(views.K[v], views.distortion[v], views.R[v], views.t[v], xyz)


def project_camera(K: np.ndarray, distortion: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Pixels (m, 2) of points (m, 3) in camera axes."""
    x, y = c[:, 0] / c[:, 2], c[:, 1] / c[:, 2]
    p1, p2 = distortion[:, 2], distortion[:, 3]
    r2 = x * x + y * y
    radial, _ = radial_factor(distortion, r2)
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([K[:, 0, 0] * xd + K[:, 0, 2], K[:, 1, 1] * yd + K[:, 1, 2]], 1)


def radial_factor(distortion: np.ndarray, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much a lens stretches places at squared radius r2 (m,), and the derivative by r2; distortion (m, 4 or 8)."""
    k = distortion
    if k.shape[1] == 4:
        return 1 + r2 * (k[:, 0] + r2 * k[:, 1]), k[:, 0] + 2 * r2 * k[:, 1]
    above = 1 + r2 * (k[:, 0] + r2 * (k[:, 1] + r2 * k[:, 4]))
    below = 1 + r2 * (k[:, 5] + r2 * (k[:, 6] + r2 * k[:, 7]))
    slope = k[:, 0] + r2 * (2 * k[:, 1] + 3 * r2 * k[:, 4])
    slope_below = k[:, 5] + r2 * (2 * k[:, 6] + 3 * r2 * k[:, 7])
    return above / below, (slope * below - above * slope_below) / below**2


def residuals(views: Views, points: SparsePoints) -> np.ndarray:
    """(k, 2) projected minus observed [px]."""
    return projected(views, points.obs_view, points.xyz[points.obs_point]) - points.obs_uv
