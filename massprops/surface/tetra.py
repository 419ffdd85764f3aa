"""Delaunay tetrahedra and what the lines of sight say of them.

Labatut, Pons, Keriven 2009 ("Robust and efficient surface reconstruction from range data"): a line of sight from a
camera to a point crosses empty tetrahedra, and the tetrahedron just behind the point is inside. Evidence near the
point is softened by its noise, 1 - exp(-t^2 / 2 sigma^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass(frozen=True)
class Tetrahedra:
    """t Delaunay tetrahedra of p points.

    Attributes:
        points: (p, 3).
        corners: (t, 4) int32 into points.
        neighbours: (t, 4) int32, the tetrahedron across from corner k, -1 outside.
    """

    points: np.ndarray
    corners: np.ndarray
    neighbours: np.ndarray

    @property
    def volume(self) -> np.ndarray:
        """(t,) volumes."""
        a, b, c, d = (self.points[self.corners[:, k]] for k in range(4))
        return np.abs(np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a))) / 6

    @property
    def facet_area(self) -> np.ndarray:
        """(t, 4) area of the facet across from corner k."""
        out = np.empty(self.corners.shape)
        for k in range(4):
            a, b, c = (self.points[self.corners[:, j]] for j in range(4) if j != k)
            out[:, k] = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return out


def tetrahedralise(points: np.ndarray) -> Tetrahedra:
    """Delaunay tetrahedra; raises `scipy.spatial.QhullError` for flat clouds."""
    from scipy.spatial import Delaunay

    found = Delaunay(points)
    return Tetrahedra(
        np.ascontiguousarray(points), found.simplices.astype(np.int32), found.neighbors.astype(np.int32)
    )


def sight_evidence(
    tetra: Tetrahedra, point: np.ndarray, centre: np.ndarray, sigma: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Evidence for empty space of r lines of sight.

    Args:
        tetra: the tetrahedra.
        point: (r,) int, the point seen, an index into `tetra.points`.
        centre: (r, 3) camera centres.
        sigma: (r,) noise of the point.
        weight: (r,) weight of the line.

    Returns:
        into (t, 4): cost of entering tetrahedron t through facet k from outside to inside; free (t,): weight of the
        lines that cross t well in front of their point.
    """
    start, tets = _incidence(tetra)
    into = np.zeros(tetra.corners.shape)
    free = np.zeros(len(tetra.corners))
    _trace(
        tetra.points, tetra.corners, tetra.neighbours, start, tets, point, centre, sigma, weight, into, free
    )
    return into, free


def behind(tetra: Tetrahedra, point: np.ndarray, direction: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(r,) the tetrahedron at `depth` from `tetra.points[point]` along `direction`, -1 where there is none."""
    start, tets = _incidence(tetra)
    return _behind(tetra.points, tetra.corners, tetra.neighbours, start, tets, point, direction, depth)


def _incidence(tetra: Tetrahedra) -> tuple[np.ndarray, np.ndarray]:
    """CSR of the tetrahedra about each point."""
    flat = tetra.corners.ravel()
    order = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[order], np.arange(len(tetra.points) + 1))
    return start.astype(np.int64), (order // 4).astype(np.int32)


@njit(cache=True)
def _first(points, corners, start, tets, p, d):  # noqa: ANN001, ANN202
    """The tetrahedron about point p that direction d enters, the corner p has in it, and where d leaves it."""
    for q in range(start[p], start[p + 1]):
        t = tets[q]
        k = 0
        while corners[t, k] != p:
            k += 1
        a = points[corners[t, (k + 1) % 4]] - points[p]
        b = points[corners[t, (k + 2) % 4]] - points[p]
        c = points[corners[t, (k + 3) % 4]] - points[p]
        bc, ca, ab = np.cross(b, c), np.cross(c, a), np.cross(a, b)
        det = (a * bc).sum()
        if det == 0:
            continue
        x, y, z = (d * bc).sum() / det, (d * ca).sum() / det, (d * ab).sum() / det
        if x >= -1e-9 and y >= -1e-9 and z >= -1e-9 and x + y + z > 0:
            return t, k, 1.0 / (x + y + z)
    return -1, -1, 0.0


@njit(cache=True)
def _next(points, corners, t, entered, origin, d):  # noqa: ANN001, ANN202
    """Facet through which the line leaves tetrahedron t, and the distance along it."""
    best, facet = 1e300, -1
    for k in range(4):
        if k == entered:
            continue
        a = points[corners[t, (k + 1) % 4]]
        n = np.cross(points[corners[t, (k + 2) % 4]] - a, points[corners[t, (k + 3) % 4]] - a)
        if ((points[corners[t, k]] - a) * n).sum() > 0:
            n = -n
        slope = (d * n).sum()
        if slope > 1e-300:
            s = ((a - origin) * n).sum() / slope
            if s < best:
                best, facet = s, k
    return facet, best


@njit(cache=True)
def _trace(points, corners, neighbours, start, tets, point, centre, sigma, weight, into, free):  # noqa: ANN001, ANN202
    for r in range(len(point)):
        p = point[r]
        origin = points[p]
        d = centre[r] - origin
        far = np.sqrt((d * d).sum())
        d = d / far
        t, facet, s = _first(points, corners, start, tets, p, d)
        for _ in range(4000):
            if t < 0 or facet < 0 or s >= far:
                break
            soft = weight[r] * (1 - np.exp(-0.5 * (s / sigma[r]) ** 2))
            into[t, facet] += soft
            after = neighbours[t, facet]
            if after < 0:
                break
            free[after] += soft
            entered = 0
            while neighbours[after, entered] != t:
                entered += 1
            t = after
            facet, s = _next(points, corners, t, entered, origin, d)


@njit(cache=True)
def _behind(points, corners, neighbours, start, tets, point, direction, depth):  # noqa: ANN001, ANN202
    out = np.full(len(point), -1, np.int64)
    for r in range(len(point)):
        p = point[r]
        t, facet, s = _first(points, corners, start, tets, p, direction[r])
        for _ in range(400):
            if t < 0 or facet < 0 or s >= depth[r]:
                break
            after = neighbours[t, facet]
            if after < 0:
                t = -1
                break
            entered = 0
            while neighbours[after, entered] != t:
                entered += 1
            t = after
            facet, s = _next(points, corners, t, entered, points[p], direction[r])
        out[r] = t
    return out
