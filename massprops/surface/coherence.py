"""Whether the silhouettes of two placements can be those of one body.

A body lies within the hull of every placement's silhouettes and above what it stood on, and every ray along the rim of
a silhouette touches it. So each rim ray of one placement must meet the hull of the other: silhouette coherence
(Hernandez, Schmitt, Cipolla 2007). Nothing of it needs points on the surface, and so it holds for plain and glossy things.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from massprops.core.levenberg_marquardt import Damping, descend
from massprops.geometry import vectors
from massprops.mass.integrals import hull_corners
from massprops.surface.silhouette import Hull
from massprops.views import Views

Array = np.ndarray

CELLS = 96
"""Cells along the longest side of a placement's grid."""
ROOM = 0.15
"""Margin of the grid about what the silhouettes leave room for, in the first shape's longest side."""
BEYOND, COARSE = 0.75, 40
"""How far beyond the first shape that is looked for, in its longest side, and nodes along the space's longest side. A plate
with a handle of which stereo had measured the one face only was as deep again, and half as long, as that face."""
STEPS = 96
"""Places along a rim ray that are looked at."""
TOUCHES = 1.0
"""A place of a rim ray farther outside its own hull than this [px] does not belong to the body."""
INWARD = 1
"""Pixels by which rims are drawn in: an outline is known no better."""
TURN, SHIFT = 0.05, 0.02
"""Steps that weigh alike in a fit [rad] and [of the grid's size]."""
ENOUGH = 1e-3
"""A fit ends with a step that betters it by less than this part."""
MOST = 25.0
"""A place farther outside than this counts no more [px]."""


@dataclass(frozen=True)
class Extent:
    """How far outside a placement's hull every place is.

    Attributes:
        value: (a, b, c) float32 [px], negative within the hull; beyond the grid `MOST`.
        origin: (3,) of the first node; step: between nodes [world units].
    """

    value: np.ndarray
    origin: np.ndarray
    step: float

    @property
    def size(self) -> float:
        """Longest side of the grid [world units]."""
        out: float = self.step * (max(self.value.shape) - 1)
        return out

    def corners(self) -> np.ndarray:
        """(k, 3) nodes within the placement's hull that are corners of their convex hull; none where there are no nodes."""
        held = self.origin + self.step * np.argwhere(self.value < 0)
        return np.asarray(held[hull_corners(held)] if len(held) else held)

    def at(self, xyz: np.ndarray) -> np.ndarray:
        """(m,) values at places (m, 3)."""
        return np.asarray(_values(self.value, self.origin, self.step, np.ascontiguousarray(xyz)))

    def of(self, groups: Witnesses, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each group, carried by R x + t, the place nearest to the hull.

        Returns:
            places (m, 3), their distances (m,) outside [px], 0 within, and gradients (m, 3).
        """
        value, place = np.empty(len(groups)), np.empty(len(groups), np.int64)
        _least(self.value, self.origin, self.step, R, t, groups.xyz, groups.start, value, place)
        x = groups.xyz[place] @ R.T + t
        slope = np.zeros((len(x), 3))
        out = np.flatnonzero((value > 0) & (value < MOST))
        for k, e in enumerate(0.5 * self.step * np.eye(3)):
            slope[out, k] = (self.at(x[out] + e) - self.at(x[out] - e)) / self.step
        return x, value, slope


@dataclass(frozen=True)
class Witnesses:
    """Groups of places, of each of which one at least belongs to the body: rim rays, and measured points alone.

    Attributes:
        xyz: (k, 3); start: (m + 1,) group i is xyz[start[i]:start[i + 1]].
    """

    xyz: np.ndarray
    start: np.ndarray

    def __len__(self) -> int:
        return len(self.start) - 1

    def rim_error(self, own: Extent, R: np.ndarray | None = None, t: np.ndarray | None = None) -> float:
        """Mean distance [px] by which the groups miss an extent, as they lie or carried by R x + t."""
        R, t = np.eye(3) if R is None else np.ascontiguousarray(R), np.zeros(3) if t is None else t
        return float(own.of(self, R, t)[1].mean()) if len(self) else 0.0

    def some(self, most: int, rng: np.random.Generator) -> Witnesses:
        """`most` of the groups, drawn at random."""
        if len(self) <= most:
            return self
        pick = np.sort(rng.permutation(len(self))[:most])
        count = np.diff(self.start)[pick]
        start = np.concatenate([[0], np.cumsum(count)])
        index = np.arange(start[-1]) + np.repeat(self.start[pick] - start[:-1], count)
        return Witnesses(self.xyz[index], start)


@dataclass(frozen=True)
class Pair:
    """Two placements that may show one body: the extents of both, and the witnesses of each."""

    first: Extent
    second: Extent
    of_first: Witnesses
    of_second: Witnesses

    def some(self, most: int, rng: np.random.Generator) -> Pair:
        """The same with `most` witnesses of each."""
        return Pair(self.first, self.second, self.of_first.some(most, rng), self.of_second.some(most, rng))

    def scores(self, turns: np.ndarray, shifts: np.ndarray) -> np.ndarray:
        """(n,) mean distance [px] by which the witnesses of each miss the extent of the other, 0 where one body fits.

        Args:
            turns: (n, 3, 3) and shifts: (n, 3): x of the second placement is R x + t of the first.
        """
        back, shift = _inverse(turns, shifts)
        a, b = self.first, self.second
        here = _mean_least(a.value, a.origin, a.step, turns, shifts, self.of_second.xyz, self.of_second.start)
        there = _mean_least(b.value, b.origin, b.step, back, shift, self.of_first.xyz, self.of_first.start)
        return np.asarray(0.5 * (here + there))

    def score(self, R: np.ndarray, t: np.ndarray) -> float:
        """The same of one way, (3, 3) and (3,)."""
        return float(self.scores(R[None], t[None])[0])

    def rows(self, R: np.ndarray, t: np.ndarray, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (m,) [px] of all witnesses and their derivatives (m, 6) by a turn about a place (3,) and a shift."""
        back, shift = _inverse(R[None], t[None])
        x, value, slope = self.first.of(self.of_second, R, t)
        y, worth, fall = self.second.of(self.of_first, back[0], shift[0])
        # what carries the second placement leaves the first's witnesses where they are
        x = np.concatenate([x, y @ R.T + t])
        slope = np.concatenate([slope, -fall @ R.T])
        return np.concatenate([value, worth]), np.column_stack([np.cross(x - about, slope), slope])

    def fitted(
        self, R: np.ndarray, t: np.ndarray, middle: np.ndarray, rounds: int = 20
    ) -> tuple[np.ndarray, np.ndarray]:
        """The turn and shift near these that the silhouettes bear best.

        Args:
            R, t: where to begin; middle: (3,) of the second placement, about which it is turned.
            rounds: most steps.
        """
        unit = np.concatenate([np.full(3, TURN), np.full(3, SHIFT * self.first.size)])

        def linearise(at: tuple[Array, Array]) -> tuple[float, tuple[Array, Array]]:
            R, t = at
            r, slope = self.rows(R, t, R @ middle + t)
            slope = slope * unit
            # steps on the squares, weighted, go towards the least mean distance
            weight = 1.0 / np.maximum(r, 1.0)
            return self.score(R, t), (slope.T @ (weight[:, None] * slope), slope.T @ (weight * r))

        def step(
            at: tuple[Array, Array], equations: tuple[Array, Array], damping: float
        ) -> tuple[float, tuple[Array, Array]]:
            (R, t), (normal, pull) = at, equations
            # damped alike in all directions (Levenberg): one that no witness shows stays where it is
            away = -np.linalg.solve(normal + (damping * np.trace(normal) + 1e-9) * np.eye(6), pull) * unit
            new = moved(R, t, R @ middle + t, away)
            return self.score(*new), new

        for descent in descend(
            (R, t), linearise, step, rounds, Damping(1e-2, lowered=3.0, raised=5.0, least=0.0, tries=5)
        ):
            R, t = descent.place
            if descent.fall < ENOUGH * (descent.cost + descent.fall):
                break
        return R, t


def moved(R: np.ndarray, t: np.ndarray, about: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R x + t, turned about a place (3,) by the first three of step (6,) [rad] and shifted by the last."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    return turn @ R, turn @ (t - about) + about + step[3:]


def _inverse(turns: np.ndarray, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    back = np.ascontiguousarray(np.swapaxes(turns, 1, 2))
    return back, -np.einsum("nij,nj->ni", back, shifts)


def extent(hull: Hull, shape: np.ndarray) -> Extent:
    """The hull on a grid about a first shape (n, 3), and about what the silhouettes leave room for beyond it.

    A first shape may lack all that stereo did not measure, such as the back of a plate that leans on its handle.
    """
    low, high = shape.min(0), shape.max(0)
    side = float((high - low).max())
    low, high = _left_room(hull, low, high, BEYOND * side)
    low, high = low - ROOM * side, high + ROOM * side
    step = float((high - low).max()) / CELLS
    return Extent(np.minimum(_on_grid(hull, low, high, step), MOST).astype(np.float32), low, step)


def _on_grid(hull: Hull, low: np.ndarray, high: np.ndarray, step: float) -> np.ndarray:
    """(a, b, c) values of the hull over a box."""
    count = np.ceil((high - low) / step).astype(int) + 1
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1)
    return hull.value(low + step * grid.reshape(-1, 3)).reshape(tuple(count))


def _left_room(hull: Hull, low: np.ndarray, high: np.ndarray, beyond: float) -> tuple[np.ndarray, np.ndarray]:
    """The box `low` to `high` of a shape, widened by at most `beyond` to hold the part of the hull that it lies in."""
    from scipy.ndimage import label

    start = low - beyond
    step = float((high - low + 2 * beyond).max()) / COARSE
    piece, _ = label(_on_grid(hull, start, high + beyond, step) < 0, np.ones((3, 3, 3)))
    shape_box = tuple(
        slice(max(int(a), 0), int(b) + 1)
        for a, b in zip(np.floor((low - start) / step), np.ceil((high - start) / step), strict=True)
    )
    held = np.unique(piece[shape_box])
    at = np.argwhere(np.isin(piece, held[held > 0]))
    if not len(at):
        return low, high
    room_points = start + step * at
    return np.minimum(low, room_points.min(0)), np.maximum(high, room_points.max(0))


def rim_rays(
    views: Views, masks: list[np.ndarray], own: Extent, most: int, rng: np.random.Generator, touches: float = TOUCHES
) -> Witnesses:
    """Places along the rays of the silhouettes' rims, as far as they lie in the placement's own hull.

    Args:
        views: n cameras; masks: n arrays (h, w) uint8, undistorted: 255 object, 0 not.
        own: of the same placement.
        most: rays, of all views together.
        touches: how far outside its own hull a place may be [px].
    """
    places, counts = [], []
    each = -(-most // max(len(masks), 1))
    far = own.origin + own.step * (np.array(own.value.shape) - 1)
    middle, radius = 0.5 * (own.origin + far), 0.5 * float(np.linalg.norm(far - own.origin))
    for i, mask in enumerate(masks):
        rim = _rim(mask)
        if not len(rim):
            continue
        pixel = rim[np.sort(rng.permutation(len(rim))[:each])]
        ray = vectors.unit(np.column_stack([pixel, np.ones(len(pixel))]) @ np.linalg.inv(views.K[i]).T @ views.R[i])
        depth = float(np.linalg.norm(middle - views.centres[i])) + np.linspace(-radius, radius, STEPS)
        xyz = views.centres[i] + depth[None, :, None] * ray[:, None, :]
        inside = (own.at(xyz.reshape(-1, 3)) < touches).reshape(xyz.shape[:2])
        places.append(xyz[inside])
        counts.append(inside.sum(1)[inside.any(1)])
    count = np.concatenate([*counts, np.zeros(0, int)])
    return Witnesses(
        np.concatenate([*places, np.zeros((0, 3))]), np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    )


def _rim(mask: np.ndarray) -> np.ndarray:
    """(m, 2) pixels u, v just within the outline of a silhouette, off the image's border."""
    import cv2

    solid = cv2.erode((mask == 255).astype(np.uint8), np.ones((3, 3), np.uint8), iterations=INWARD)
    edge = solid - cv2.erode(solid, np.ones((3, 3), np.uint8))
    sky = cv2.dilate((mask == 0).astype(np.uint8), np.ones((3, 3), np.uint8), iterations=INWARD + 1)
    edge = edge * sky
    edge[:3], edge[-3:], edge[:, :3], edge[:, -3:] = 0, 0, 0, 0
    v, u = np.nonzero(edge)
    return np.column_stack([u, v]).astype(float)


@njit(cache=True, inline="always", error_model="numpy")
def _value(grid: Array, origin: Array, step: float, x: float, y: float, z: float) -> float:
    a, b, c = (x - origin[0]) / step, (y - origin[1]) / step, (z - origin[2]) / step
    i, j, k = int(np.floor(a)), int(np.floor(b)), int(np.floor(c))
    if i < 0 or j < 0 or k < 0 or i >= grid.shape[0] - 1 or j >= grid.shape[1] - 1 or k >= grid.shape[2] - 1:
        return MOST
    a, b, c = a - i, b - j, c - k
    near = (grid[i, j, k] * (1 - c) + grid[i, j, k + 1] * c) * (1 - b)
    near += (grid[i, j + 1, k] * (1 - c) + grid[i, j + 1, k + 1] * c) * b
    far = (grid[i + 1, j, k] * (1 - c) + grid[i + 1, j, k + 1] * c) * (1 - b)
    far += (grid[i + 1, j + 1, k] * (1 - c) + grid[i + 1, j + 1, k + 1] * c) * b
    out: float = near * (1 - a) + far * a
    return out


@njit(cache=True, error_model="numpy")
def _values(grid: Array, origin: Array, step: float, xyz: Array) -> Array:
    out = np.empty(len(xyz))
    for i in range(len(xyz)):
        out[i] = _value(grid, origin, step, xyz[i, 0], xyz[i, 1], xyz[i, 2])
    return out


@njit(cache=True, error_model="numpy")
def _least(
    grid: Array, origin: Array, step: float, R: Array, t: Array, xyz: Array, start: Array, value: Array, place: Array
) -> None:
    """Of each group, carried by R x + t, the least value and which place has it; a value within the hull ends it."""
    for g in range(len(start) - 1):
        best, at = MOST, start[g]
        for i in range(start[g], start[g + 1]):
            x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            d = _value(
                grid, origin, step,
                R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0],
                R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1],
                R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2],
            )  # fmt: skip
            if d < best:
                best, at = d, i
                if d <= 0:
                    break
        value[g], place[g] = max(best, 0.0), at


@njit(cache=True, error_model="numpy")
def _mean_least(
    grid: Array, origin: Array, step: float, turns: Array, shifts: Array, xyz: Array, start: Array
) -> Array:
    """(n,) mean over the groups of the least value, for n ways of carrying them."""
    out = np.zeros(len(turns))
    value, place = np.empty(len(start) - 1), np.empty(len(start) - 1, np.int64)
    for n in range(len(turns)):
        _least(grid, origin, step, turns[n], shifts[n], xyz, start, value, place)
        total = 0.0
        for g in range(len(value)):
            total += value[g]
        out[n] = total / max(len(value), 1)
    return out
