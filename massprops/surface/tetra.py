"""Delaunay tetrahedra and what the lines of sight say of them.

Labatut, Pons, Keriven 2009 ("Robust and efficient surface reconstruction from range data"): a line of sight from a
camera to a point crosses empty tetrahedra, and the tetrahedron just behind the point is inside. Evidence near the
point is softened by its noise, 1 - exp(-t^2 / 2 sigma^2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

Array = np.ndarray


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

    @cached_property
    def volume(self) -> np.ndarray:
        """(t,) volumes."""
        a, b, c, d = (self.points[self.corners[:, k]] for k in range(4))
        return np.abs(np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a))) / 6

    @cached_property
    def facets(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Each facet between two tetrahedra once: t, k (f,) it lies across from corner k of t; other, back (f,) likewise
        from the other side."""
        t, k = np.nonzero(self.neighbours >= 0)
        other = self.neighbours[t, k]
        once = t < other
        t, k, other = t[once], k[once], other[once]
        return t, k, other, np.argmax(self.neighbours[other] == t[:, None], axis=1)

    @cached_property
    def incidence(self) -> tuple[np.ndarray, np.ndarray]:
        """CSR of the tetrahedra about each point: (p + 1,) int64 and (4t,) int32."""
        flat = self.corners.ravel()
        order = np.argsort(flat, kind="stable")
        start = np.searchsorted(flat[order], np.arange(len(self.points) + 1))
        return start.astype(np.int64), (order // 4).astype(np.int32)

    @property
    def facet_area(self) -> np.ndarray:
        """(t, 4) area of the facet across from corner k."""
        return np.asarray(_facet_areas(self.points, self.corners))


def tetrahedralise(points: np.ndarray) -> Tetrahedra:
    """Delaunay tetrahedra of points (n, 3); raises `scipy.spatial.QhullError` for flat clouds."""
    from scipy.spatial import Delaunay

    triangulation = Delaunay(points)
    return Tetrahedra(
        np.ascontiguousarray(points), triangulation.simplices.astype(np.int32), triangulation.neighbors.astype(np.int32)
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
    into = np.zeros(tetra.corners.shape)
    free = np.zeros(len(tetra.corners))
    lines = (point, centre, sigma, weight)
    _trace(tetra.points, tetra.corners, tetra.neighbours, tetra.incidence, lines, into, free)
    return into, free


def tetrahedra_at_depth(tetra: Tetrahedra, point: np.ndarray, direction: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(r,) the tetrahedron at `depth` from `tetra.points[point]` along `direction`, -1 where there is none."""
    start, tets = tetra.incidence
    return _tetrahedra_at_depth(tetra.points, tetra.corners, tetra.neighbours, start, tets, point, direction, depth)


@njit(cache=True, error_model="numpy")
def _facet_areas(points: Array, corners: Array) -> Array:
    out = np.empty(corners.shape)
    for t in range(len(corners)):
        for k in range(4):
            a, b, c = corners[t, 1 if k == 0 else 0], corners[t, 2 if k < 2 else 1], corners[t, 2 if k == 3 else 3]
            ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
            vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            out[t, k] = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
    return out


@njit(cache=True, inline="always", error_model="numpy")
def _triple(ax: float, ay: float, az: float, bx: float, by: float, bz: float, cx: float, cy: float, cz: float) -> float:
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@njit(cache=True, error_model="numpy")
def _first(points: Array, corners: Array, start: Array, tets: Array, p: int, d: Array) -> tuple[int, int, float]:
    """The tetrahedron about point p that direction d enters, the corner p has in it, and where d leaves it."""
    px, py, pz = points[p, 0], points[p, 1], points[p, 2]
    for q in range(start[p], start[p + 1]):
        t = tets[q]
        k = 0
        while corners[t, k] != p:
            k += 1
        i, j, m = corners[t, (k + 1) % 4], corners[t, (k + 2) % 4], corners[t, (k + 3) % 4]
        ax, ay, az = points[i, 0] - px, points[i, 1] - py, points[i, 2] - pz
        bx, by, bz = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
        cx, cy, cz = points[m, 0] - px, points[m, 1] - py, points[m, 2] - pz
        det = _triple(ax, ay, az, bx, by, bz, cx, cy, cz)
        if det == 0:
            continue
        x = _triple(d[0], d[1], d[2], bx, by, bz, cx, cy, cz) / det
        y = _triple(ax, ay, az, d[0], d[1], d[2], cx, cy, cz) / det
        z = _triple(ax, ay, az, bx, by, bz, d[0], d[1], d[2]) / det
        if x >= -1e-9 and y >= -1e-9 and z >= -1e-9 and x + y + z > 0:
            return t, k, 1.0 / (x + y + z)
    return -1, -1, 0.0


@njit(cache=True, error_model="numpy")
def _next(points: Array, corners: Array, t: int, entered: int, o: Array, d: Array) -> tuple[int, float]:
    """Facet through which the line leaves tetrahedron t, and the distance along it."""
    best, facet = 1e300, -1
    for k in range(4):
        if k == entered:
            continue
        i, j, m, q = corners[t, (k + 1) % 4], corners[t, (k + 2) % 4], corners[t, (k + 3) % 4], corners[t, k]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        ux, uy, uz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
        vx, vy, vz = points[m, 0] - ax, points[m, 1] - ay, points[m, 2] - az
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        if (points[q, 0] - ax) * nx + (points[q, 1] - ay) * ny + (points[q, 2] - az) * nz > 0:
            nx, ny, nz = -nx, -ny, -nz
        slope = d[0] * nx + d[1] * ny + d[2] * nz
        if slope > 1e-300:
            s = ((ax - o[0]) * nx + (ay - o[1]) * ny + (az - o[2]) * nz) / slope
            if s < best:
                best, facet = s, k
    return facet, best


@njit(cache=True, error_model="numpy")
def _trace(
    points: Array,
    corners: Array,
    neighbours: Array,
    incidence: tuple[Array, Array],
    lines: tuple[Array, Array, Array, Array],
    into: Array,
    free: Array,
) -> None:
    (start, tets), (point, centre, sigma, weight) = incidence, lines
    d = np.empty(3)
    for r in range(len(point)):
        p = point[r]
        origin = points[p]
        far = 0.0
        for i in range(3):
            d[i] = centre[r, i] - origin[i]
            far += d[i] * d[i]
        far = np.sqrt(far)
        for i in range(3):
            d[i] /= far
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


@njit(cache=True, error_model="numpy")
def _tetrahedra_at_depth(
    points: Array,
    corners: Array,
    neighbours: Array,
    start: Array,
    tets: Array,
    point: Array,
    direction: Array,
    depth: Array,
) -> Array:
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
