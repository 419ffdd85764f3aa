"""The dense points: reading, thinning to a bounded number, and taking their noise out without moving the surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.geometry.vectors import unit
from massprops.views import entries

RAYS = 5
"""Most views kept for one thinned point: more rays say the same again."""


@dataclass(frozen=True)
class Cloud:
    """n oriented points on the object's surface, in the world of the reconstruction.

    Attributes:
        xyz: (n, 3).
        normal: (n, 3) unit, outward.
        sigma: (n,) 1-sigma of the position along the normal.
        view_start: (n + 1,) and view_index (k,): the views in which point i was seen are
            `view_index[view_start[i]:view_start[i + 1]]`.
    """

    xyz: np.ndarray
    normal: np.ndarray
    sigma: np.ndarray
    view_start: np.ndarray
    view_index: np.ndarray

    def __len__(self) -> int:
        return len(self.xyz)

    @staticmethod
    def load(path: Path) -> Cloud:
        """Reads the dense stage's `points.npz`; points that are not finite are left out."""
        with open_arrays(path) as z:
            cloud = Cloud(**{k: z[k] for k in Cloud.__dataclass_fields__})
        return cloud.finite()

    def save(self, path: Path) -> None:
        """Writes one `.npz`."""
        np.savez(path, **{k: getattr(self, k) for k in self.__dataclass_fields__})

    def of_views(self, number: np.ndarray) -> Cloud:
        """The points with their views numbered anew: number (n,) gives the new one of each, -1 for those that go.

        Points that no view is left of go too.
        """
        owner = np.repeat(np.arange(len(self)), np.diff(self.view_start))
        view = number[self.view_index]
        count = np.bincount(owner[view >= 0], minlength=len(self))
        start = np.concatenate([[0], np.cumsum(count)])
        kept = replace(self, view_start=start, view_index=view[view >= 0])
        return kept.take(np.flatnonzero(count > 0))

    def moved(self, R: np.ndarray, t: np.ndarray, views: int) -> Cloud:
        """The points at R x + t, R (3, 3), t (3,), their views numbered from `views` on."""
        return replace(self, xyz=self.xyz @ R.T + t, normal=self.normal @ R.T, view_index=self.view_index + views)

    @staticmethod
    def joined(clouds: list[Cloud]) -> Cloud:
        """All points of several clouds."""
        counts = np.concatenate([np.diff(c.view_start) for c in clouds])
        return Cloud(
            np.concatenate([c.xyz for c in clouds]),
            np.concatenate([c.normal for c in clouds]),
            np.concatenate([c.sigma for c in clouds]),
            np.concatenate([[0], np.cumsum(counts)]),
            np.concatenate([c.view_index for c in clouds]),
        )

    @property
    def is_finite(self) -> np.ndarray:
        """(n,) bool: place, normal and noise are numbers."""
        length = np.linalg.norm(self.normal, axis=1)
        return np.isfinite(self.xyz).all(1) & np.isfinite(self.sigma) & (self.sigma > 0) & (length > 0.5)

    def finite(self) -> Cloud:
        """The points that are numbers, as 64-bit floats."""
        good = self.is_finite
        xyz, normal, sigma = (a.astype(float) for a in (self.xyz, self.normal, self.sigma))
        cloud = Cloud(xyz, normal, sigma, self.view_start.astype(np.int64), self.view_index.astype(np.int64))
        return cloud if good.all() else cloud.take(np.flatnonzero(good))

    def take(self, index: np.ndarray) -> Cloud:
        """The points at `index` (integers)."""
        start = np.concatenate([[0], np.cumsum(np.diff(self.view_start)[index])])
        place = entries(self.view_start, index)[1]
        return Cloud(self.xyz[index], self.normal[index], self.sigma[index], start, self.view_index[place])


@dataclass(frozen=True)
class Thinned:
    """m points that stand for the cloud.

    Attributes:
        xyz: (m, 3) on the local plane through the cloud.
        normal: (m, 3).
        sigma: (m,) 1-sigma of one point of the cloud there.
        views: (m, RAYS) int, views that see it, -1 where there are fewer.
        spacing: typical distance between neighbours.
    """

    xyz: np.ndarray
    normal: np.ndarray
    sigma: np.ndarray
    views: np.ndarray
    spacing: float

    def take(self, which: np.ndarray) -> Thinned:
        """Some of the points, of as many or by (m,) bool."""
        return Thinned(self.xyz[which], self.normal[which], self.sigma[which], self.views[which], self.spacing)


def without_outliers(cloud: Cloud) -> Cloud:
    """The cloud less points that stand alone."""
    return cloud.take(agreeing(cloud))


def agreeing(cloud: Cloud) -> np.ndarray:
    """Indices (k,) of points that do not stand alone: not too far from their 8th neighbour, nor off every neighbour's plane."""
    from scipy.spatial import cKDTree

    near, index = cKDTree(cloud.xyz).query(cloud.xyz, k=9)
    alone = near[:, -1] > 6 * np.median(near[:, -1])
    step = cloud.xyz[index[:, 1:]] - cloud.xyz[:, None]
    facing = np.einsum("nki,ni->nk", cloud.normal[index[:, 1:]], cloud.normal) > 0.5
    off = np.abs(np.einsum("nki,ni->nk", step, cloud.normal))
    limit = 4 * cloud.sigma + 0.35 * np.median(near[:, -1])
    alike = (facing & (off < limit[:, None])).sum(1)
    return np.flatnonzero(~alone & (alike >= 3))


def thin(cloud: Cloud, target: int, seed: int = 0) -> Thinned:
    """At most about `target` points: one for each cell of space and direction of the normal, then smoothed.

    The two sides of a thin plate never meet in one point, since their normals differ.
    """
    spacing = max(_spacing(cloud.xyz, target), _apart(cloud.xyz))
    key = np.floor((cloud.xyz - cloud.xyz.min(0)) / spacing).astype(np.int64)
    axis = np.argmax(np.abs(cloud.normal), axis=1)
    side = 2 * axis + (cloud.normal[np.arange(len(cloud)), axis] > 0)
    code = ((key[:, 0] * 4096 + key[:, 1]) * 4096 + key[:, 2]) * 6 + side
    _, inverse, count = np.unique(code, return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(inverse, cloud.xyz[:, k]) / count for k in range(3)], axis=1)
    normal = np.stack([np.bincount(inverse, cloud.normal[:, k]) for k in range(3)], axis=1)
    normal = unit(normal)
    sigma = np.bincount(inverse, cloud.sigma) / count
    mean, normal, support = project_to_cloud(cloud, mean, normal, 1.6 * spacing)
    views = _spread_views(cloud, inverse, len(count), seed)
    keep = support >= 3
    return Thinned(mean[keep], normal[keep], sigma[keep], views[keep], spacing)


def _spacing(xyz: np.ndarray, target: int) -> float:
    """Cell size at which about `target` cells are occupied."""
    extent = float(np.linalg.norm(xyz.max(0) - xyz.min(0)))
    low, high = extent / 2000, extent / 20
    for _ in range(12):
        middle = np.sqrt(low * high)
        key = np.floor((xyz - xyz.min(0)) / middle).astype(np.int64)
        occupied = len(np.unique((key[:, 0] * 4096 + key[:, 1]) * 4096 + key[:, 2]))
        low, high = (middle, high) if occupied > 0.8 * target else (low, middle)
    return float(high)


def _apart(xyz: np.ndarray) -> float:
    """Half the median distance to the eighth neighbour: cells finer than that have no neighbours to be smoothed with."""
    from scipy.spatial import cKDTree

    few = xyz[:: max(1, len(xyz) // 4000)]
    return 0.5 * float(np.median(cKDTree(xyz).query(few, k=min(9, len(xyz)))[0][:, -1]))


def _spread_views(cloud: Cloud, cell: np.ndarray, cells: int, seed: int) -> np.ndarray:
    """(cells, RAYS) up to RAYS different views of each cell, drawn from all its points."""
    owner = np.repeat(cell, np.diff(cloud.view_start))
    pairs = np.unique(owner * 65536 + cloud.view_index)
    rng = np.random.default_rng([seed, 11])
    pairs = pairs[np.lexsort((rng.random(len(pairs)), pairs // 65536))]
    owner, view = pairs // 65536, pairs % 65536
    rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
    out = np.full((cells, RAYS), -1, np.int64)
    few = rank < RAYS
    out[owner[few], rank[few]] = view[few]
    return out


def project_to_cloud(
    cloud: Cloud, xyz: np.ndarray, normal: np.ndarray, radius: float, k: int = 32
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moves points along their normals onto the local plane of the cloud (moving least squares, Alexa et al. 2003).

    A plane, and not a mean, is fitted to the neighbours: a mean would pull open borders inward. Neighbours whose
    normal is more than 60 degrees off (the other side of a plate) have no say; those far off the plane have little.

    Args:
        cloud: the measured points.
        xyz, normal: (m, 3) points to move.
        radius: reach of the fit.
        k: most neighbours.

    Returns:
        moved (m, 3), normals of the planes (m, 3), number of neighbours used (m,).
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(cloud.xyz)
    moved, turned, support = xyz.copy(), normal.copy(), np.zeros(len(xyz), int)
    for start in range(0, len(xyz), 8192):
        part = slice(start, start + 8192)
        _, index = tree.query(xyz[part], k=k, distance_upper_bound=radius)
        has_neighbour = index < len(cloud)
        index = np.where(has_neighbour, index, 0)
        n = normal[part]
        helper = np.where(np.abs(n[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
        u = unit(np.cross(n, helper))
        v = np.cross(n, u)
        step = cloud.xyz[index] - xyz[part][:, None]
        facing = np.einsum("mki,mi->mk", cloud.normal[index], n)
        good = has_neighbour & (facing > 0.5)
        a, b, c = (np.einsum("mki,mi->mk", step, d) for d in (u, v, n))
        weight = np.where(good, (1 - np.minimum((a * a + b * b) / radius**2, 1)) ** 2, 0.0)
        weight = weight / cloud.sigma[index] ** 2 * np.median(cloud.sigma) ** 2
        design = np.stack([np.ones_like(a), a / radius, b / radius], axis=-1)
        offset = np.zeros((len(n), 3))
        robust = weight
        for _ in range(3):
            normalm = np.einsum("mki,mkj,mk->mij", design, design, robust) + 1e-2 * np.diag([1e-6, 1, 1])
            right = np.einsum("mki,mk->mi", design, robust * c)
            offset = np.linalg.solve(normalm, right[..., None])[..., 0]
            residual = (c - np.einsum("mki,mi->mk", design, offset)) / (2.5 * cloud.sigma[index])
            robust = weight / (1 + residual**2) ** 2
        enough = good.sum(1) >= 3
        limit = 0.5 * radius
        shift = np.where(enough, np.clip(offset[:, 0], -limit, limit), 0.0)
        moved[part] = xyz[part] + shift[:, None] * n
        slope = np.clip(offset[:, 1:] / radius, -1, 1) * enough[:, None]
        turned[part] = unit(n - slope[:, :1] * u - slope[:, 1:] * v)
        support[part] = good.sum(1)
    return moved, turned, support
