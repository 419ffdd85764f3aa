"""Space within a closed body that nothing proves to be material: what an unseen underside may hide.

An object that stands on a plane is closed there, and filled up to what was seen from above. What was seen proves a wall
and no more: as thick as walls of it are that were seen from both sides, and where there are none, as thick as the noise.
Beyond that, what can be reached from the unseen underside may be empty.

How likely that is, the upper side shows. Below a side that bulges, a hollow is possible and nothing speaks for it. Where
the upper side is itself hollow, so that water would stand in it, the thing is a vessel, and its floor is a wall: one
thicker than the vessel is deep would be odd. A plate on a foot, a cup with a raised bottom, a jug of whose inside nothing
was measured are such.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit

from massprops.mass.integrals import PAIRS

Array = np.ndarray

CELLS, LAYERS = 120, 60
"""Columns along the longer side of the body, and at least so many layers of them."""
MOSTLY = 0.5
"""Share of its outline that water would cover, from which on the whole thing is a vessel."""
WALL, LEAST_WALLS = 0.1, 0.02
"""Share of what was seen from both sides that is thinner than a wall is taken to be, and share of the seen surface that
must be so seen."""
ROUGHLY, FEW = 1.0, 1000
"""Relative error of the distances, and number of faces, by which most points deep in a thick wall are told to be near it."""
RESOLVED = 4.0
"""Spacings of the vertices that a wall must be thick: of a thinner one the mesh knows nothing but that it is thin; and
that water must be deep to be no roughness of a flat top."""


@dataclass(frozen=True)
class Hollows:
    """Integrals (10,) of space that may be empty, about the origin of the vertices (`massprops.mass.integrals`).

    Attributes:
        possible: all that can be reached from the unseen underside without crossing a wall that was seen.
        likely: the part of it below what was seen hollow.
    """

    possible: np.ndarray
    likely: np.ndarray


@dataclass(frozen=True)
class Grid:
    """Cuboids over the plane: corner (3,) of the first, step (3,), shape (3,), in axes `base` (3, 3) whose third is the
    plane's normal, `offset` of the plane from the origin."""

    corner: np.ndarray
    step: np.ndarray
    shape: np.ndarray
    base: np.ndarray
    offset: float

    def world(self, index: np.ndarray) -> np.ndarray:
        """Middles (k, 3) of the cuboids at `index` (k, 3)."""
        return (self.corner + (index + 0.5) * self.step - [0.0, 0.0, self.offset]) @ self.base


def hollows(
    vertices: np.ndarray,
    faces: np.ndarray,
    observed: np.ndarray,
    support: np.ndarray,
    noise: float,
    spacing: float,
    walls_alike: bool = True,
) -> Hollows:
    """What may be empty of a closed body that stands on a plane.

    Args:
        vertices: (v, 3); faces: (f, 3), closed and wound outward; observed: (f,) bool.
        support: (4,) the plane, its normal towards the body.
        noise: of the measured surface, the least thickness that it proves.
        spacing: of the vertices.
        walls_alike: its walls are as thick as those that were seen from both sides; else as thin as the noise.
    """
    grid, local = grid_of(vertices, support)
    cell, height, face = columns_of(grid, local, faces)
    start, count = runs_of(cell)
    start, count = start[count >= 2], count[count >= 2]
    solid = solid_cells(grid, cell, height, start, count)
    index = np.argwhere(solid)
    loose = np.zeros(solid.shape, bool)
    walls = np.flatnonzero(observed)
    wall = wall_thickness(vertices, faces[walls]) if walls_alike else 0.0
    sheet = wall if wall > RESOLVED * spacing else noise
    loose[tuple(index.T)] = ~within(grid.world(index), vertices, faces[walls], sheet)
    underside_unseen = np.zeros(grid.shape[0] * grid.shape[1], bool)
    underside_unseen[cell[start[~observed[face[start]]]]] = True
    loose = _reached(loose, solid, underside_unseen.reshape(tuple(grid.shape[:2])))
    vessel = _vessel(grid, cell, height, start, count, ~observed[face[start + count - 1]], RESOLVED * spacing)
    likely = loose & vessel[:, :, None]
    return Hollows(*(integrals_of(np.argwhere(which), grid) for which in (loose, likely)))


def hollowed(rows: np.ndarray, body: np.ndarray, space: np.ndarray, seed: int) -> np.ndarray:
    """Replicates (r, 10) of a body (10,) some of whose material may be missing.

    Nothing tells which share of the space (10,) is empty: it is drawn by Jeffreys' prior of a share, which gives both
    ends, all and nothing, their due. What is left is as uncertain as before, relative to its volume.
    """
    share = np.random.default_rng([seed, 31]).beta(0.5, 0.5, len(rows))[:, None]
    return body - share * space + (1 - share * space[0] / body[0]) * (rows - body)


def wall_thickness(vertices: np.ndarray, faces: np.ndarray) -> float:
    """How thin walls are that were seen from both sides; 0 where next to none were. Faces (f, 3) are the seen ones."""
    from scipy.spatial import cKDTree

    from massprops.surface.refine import face_normals

    few = faces[:: max(1, len(faces) // 20_000)]
    if len(few) < 100:
        return 0.0
    middle, normal = vertices[few].mean(1), face_normals(vertices, few)
    corner = vertices[few]
    edge = float(np.median(np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1))) * np.sqrt(len(faces) / len(few))
    tree = cKDTree(middle)
    size = float(np.linalg.norm(np.ptp(middle, axis=0)))
    sampled_faces = np.arange(0, len(few), max(1, len(few) // 2000))
    thickness = np.full(len(sampled_faces), np.inf)
    # along the inward normal in growing steps, until a side that looks elsewhere is met: a wall if it looks back
    depth = 2 * edge
    while depth < size:
        near, other = tree.query(middle[sampled_faces] - depth * normal[sampled_faces])
        along = np.einsum("ij,ij->i", normal[other], normal[sampled_faces])
        met = (along < 0.3) & (near < max(edge, 0.3 * depth)) & np.isinf(thickness)
        thick = np.einsum("ij,ij->i", middle[sampled_faces] - middle[other], normal[sampled_faces])
        thickness[met] = np.where(along < -0.7, thick, np.nan)[met]
        depth *= 1.3
    seen = thickness[np.isfinite(thickness) & (thickness > 0)]
    return float(np.quantile(seen, WALL)) if len(seen) > LEAST_WALLS * len(sampled_faces) else 0.0


def grid_of(vertices: np.ndarray, support: np.ndarray) -> tuple[Grid, np.ndarray]:
    """The grid, and the vertices (v, 3) in its axes, the third from the plane."""
    first = np.linalg.svd(support[None, :3])[2][1]
    base = np.stack([first, np.cross(support[:3], first), support[:3]])
    local = vertices @ base.T + [0.0, 0.0, support[3]]
    low, high = local.min(0), local.max(0)
    flat = float((high - low)[:2].max()) / CELLS
    step = np.array([flat, flat, min(flat, (high - low)[2] / LAYERS)])
    return Grid(low - step, step, np.ceil((high - low) / step).astype(int) + 2, base, float(support[3])), local


def columns_of(grid: Grid, local: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the columns cross the faces, from below: cell (c,), height over the plane (c,), face (c,)."""
    xy = np.ascontiguousarray((local[:, :2] - grid.corner[:2]) / grid.step[:2] - 0.5)
    rows, columns = grid.shape[:2].tolist()
    args = xy, np.ascontiguousarray(local[:, 2]), np.ascontiguousarray(faces, np.int64), rows, columns
    size = _cross(*args, np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))
    cell, height, face = np.zeros(size, np.int64), np.zeros(size), np.zeros(size, np.int64)
    _cross(*args, cell, height, face)
    order = np.lexsort((height, cell))
    return cell[order], height[order], face[order]


def runs_of(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each column begins among the crossings (`columns_of`), (k,), and how many it has, (k,)."""
    start = np.flatnonzero(np.diff(cell, prepend=-1) > 0)
    return start, np.diff(np.append(start, len(cell)))


@njit(cache=True, error_model="numpy")
def _cross(xy: Array, z: Array, faces: Array, rows: int, columns: int, cell: Array, height: Array, face: Array) -> int:
    """Number of crossings; written where there is room."""
    n = 0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        for i in range(max(0, int(np.ceil(min(ax, bx, cx)))), min(rows - 1, int(np.floor(max(ax, bx, cx)))) + 1):
            for j in range(max(0, int(np.ceil(min(ay, by, cy)))), min(columns - 1, int(np.floor(max(ay, by, cy)))) + 1):
                p = ((bx - i) * (cy - j) - (by - j) * (cx - i)) / area
                q = ((cx - i) * (ay - j) - (cy - j) * (ax - i)) / area
                if p < 0.0 or q < 0.0 or p + q > 1.0:
                    continue
                if n < len(cell):
                    cell[n], height[n], face[n] = i * columns + j, p * z[a] + q * z[b] + (1 - p - q) * z[c], f
                n += 1
    return n


def solid_cells(grid: Grid, cell: np.ndarray, height: np.ndarray, start: np.ndarray, count: np.ndarray) -> np.ndarray:
    """(a, b, c) bool: cuboids whose middle lies within the body."""
    turn = np.zeros((*grid.shape[:2], grid.shape[2] + 1), np.int32)
    flat = turn.reshape(-1, grid.shape[2] + 1)
    for k in range(int(count.max(initial=0)) // 2 * 2):
        has = start[count // 2 * 2 > k]
        layer = np.ceil((height[has + k] - grid.corner[2]) / grid.step[2] - 0.5).astype(int)
        np.add.at(flat, (cell[has], np.clip(layer, 0, grid.shape[2])), 1 if k % 2 == 0 else -1)
    return np.asarray(np.cumsum(turn, axis=2)[:, :, :-1] > 0)


def solid_of(vertices: np.ndarray, faces: np.ndarray) -> tuple[Grid, np.ndarray]:
    """A grid along z, and the cuboids (a, b, c) bool of it whose middle lies within a closed body."""
    grid, local = grid_of(vertices, np.array([0.0, 0.0, 1.0, -float(vertices[:, 2].min())]))
    cell, height, _ = columns_of(grid, local, faces)
    start, count = runs_of(cell)
    return grid, solid_cells(grid, cell, height, start[count >= 2], count[count >= 2])


def within(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, sheet: float) -> np.ndarray:
    """(k,) bool: points (k, 3) no farther than `sheet` from the faces."""
    from scipy.spatial import cKDTree

    from massprops.surface.refine import edge_length, face_normals

    if not len(faces) or not len(points):
        return np.zeros(len(points), bool)
    middle, normal = vertices[faces].mean(1), face_normals(vertices, faces)
    edge = edge_length(vertices, faces)
    # the middle of a ball is as far from all of its faces: which one is nearest takes long to tell, and mostly does not matter
    some = cKDTree(middle[:: max(1, len(faces) // FEW)])
    near = some.query(points, eps=ROUGHLY, distance_upper_bound=sheet)[0] < sheet
    rest = points[~near]
    away, nearest = cKDTree(middle).query(rest, distance_upper_bound=sheet + 2 * edge)
    has_nearest = np.isfinite(away)
    nearest = np.where(has_nearest, nearest, 0)
    deep = np.abs(np.einsum("ij,ij->i", rest - middle[nearest], normal[nearest]))
    beside = np.sqrt(np.maximum(away**2 - deep**2, 0.0), where=has_nearest, out=np.zeros(len(rest)))
    near[~near] = has_nearest & (np.hypot(deep, np.maximum(beside - edge, 0.0)) < sheet)
    return np.asarray(near)


def _reached(loose: np.ndarray, solid: np.ndarray, underside_unseen: np.ndarray) -> np.ndarray:
    """What hangs together with the underside where it was not seen; underside_unseen (a, b) says in which columns."""
    from scipy.ndimage import label

    lowest = solid & (np.cumsum(solid, axis=2) == 1) & underside_unseen[:, :, None]
    piece, _ = label(loose)
    first = np.unique(piece[lowest & loose])
    return np.isin(piece, first[first > 0])


def water_held(vertices: np.ndarray, faces: np.ndarray, support: np.ndarray, spacing: float) -> float:
    """Volume of the water that stands in a body's upper side.

    Args:
        vertices: (v, 3); faces: (f, 3), closed and wound outward.
        support: (4,) the plane it stands on, its normal towards the body.
        spacing: of the vertices: pools nowhere deeper than `RESOLVED` of it are roughness.
    """
    grid, local = grid_of(vertices, support)
    cell, height, _ = columns_of(grid, local, faces)
    start, count = runs_of(cell)
    ground = _ground(grid, cell, height, start, count)
    return float(_water(ground, RESOLVED * spacing)[0].sum() * np.prod(grid.step[:2]))


def _ground(grid: Grid, cell: np.ndarray, height: np.ndarray, start: np.ndarray, count: np.ndarray) -> np.ndarray:
    """(a, b) height of the upper side over the plane, 0 beside the body; columns as for `_vessel`."""
    ground = np.zeros(tuple(int(n) for n in grid.shape[:2]))
    ground.ravel()[cell[start]] = np.maximum(height[start + count - 1], 0.0)
    return ground


def _vessel(
    grid: Grid,
    cell: np.ndarray,
    height: np.ndarray,
    start: np.ndarray,
    count: np.ndarray,
    dim: np.ndarray,
    least: float,
) -> np.ndarray:
    """(a, b) bool: columns below a hollow that was seen from above; all of them where it is a vessel.

    Args:
        cell, height: (c,) crossings; start, count: (k,) of each column; dim: (k,) bool, its top was not measured.
        least: depth that a pool must have somewhere.
    """
    shape = tuple(int(n) for n in grid.shape[:2])
    ground, there = _ground(grid, cell, height, start, count), np.zeros(shape, bool)
    there.ravel()[cell[start]] = True
    depth, deepest = _water(ground, max(least, 1e-6 * float(ground.max(initial=1.0))))
    thick = np.zeros(shape)
    thick.ravel()[cell[start]] = height[start + 1] - height[start]
    # what was not measured of a hollow's floor may lie deeper
    unsure = np.zeros(shape, bool)
    unsure.ravel()[cell[start[dim]]] = True
    wet = depth > 0
    thin = wet.any() and np.median(thick[wet]) <= depth.max()
    if thin and np.count_nonzero(wet) > MOSTLY * np.count_nonzero(wet | there):
        return there
    return there & wet & ((thick <= deepest) | unsure)


def _water(ground: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth (a, b) of water that stands on a ground of heights (a, b), 0 in pools nowhere deeper than `least`, and the
    greatest depth of each pool.

    What stands on its support is closed by it: water runs off over the outer rim only (Barnes, Lehman, Mulla 2014).
    """
    from scipy.ndimage import label, maximum

    level = np.full(ground.shape, np.inf)
    level[[0, -1]] = level[:, [0, -1]] = 0.0
    heap = [(0.0, int(i), int(j)) for i, j in np.argwhere(level == 0.0)]
    while heap:
        now, i, j = heapq.heappop(heap)
        for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if 0 <= a < ground.shape[0] and 0 <= b < ground.shape[1] and level[a, b] == np.inf:
                level[a, b] = max(now, ground[a, b])
                heapq.heappush(heap, (float(level[a, b]), a, b))
    depth = level - ground
    pool, number = label(depth > 0)
    deepest = np.concatenate([[0.0], np.atleast_1d(maximum(depth, pool, np.arange(1, number + 1)))])[pool]
    depth = np.where(deepest > least, depth, 0.0)
    return depth, deepest


def integrals_of(index: np.ndarray, grid: Grid) -> np.ndarray:
    """(10,) of the cuboids at `index` (k, 3)."""
    volume = float(np.prod(grid.step))
    middle = grid.world(index)
    cuboid_moments = len(index) * grid.base.T @ np.diag(grid.step**2 / 12) @ grid.base
    second = volume * (cuboid_moments + middle.T @ middle)
    return np.array([volume * len(index), *(volume * middle.sum(0)), *(second[a, b] for a, b in PAIRS)])
