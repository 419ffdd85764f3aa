"""Turns under which a body looks the same, so that its images could as well be placed a turn away.

Sides with the same solar cells, or the two sides of a plate, are told apart by what stands beside them and by the order
of the images in time, not by themselves. For each principal axis and number of sides the measured points are turned and
laid back onto themselves (trimmed point-to-plane ICP: Chen and Medioni 1992; Chetverikov and others 2005). Where they lie
on each other the paint is compared with what chance gives, which is the same points slid along the surface. An image
could be placed a turn away where the turned body covers its silhouette as well as the body itself, and the points that
it shows lie on points of the same paint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.surface.cloud import Cloud
from massprops.surface.paint import correlation, texture

FOLDS = (6, 5, 4, 3, 2)
"""Numbers of sides that are tried, the most first: a body of four like sides is one of two as well."""
SAMPLED, LAID = 4000, 1000
"""Measured points that are turned, and those of them by which they are laid onto each other."""
ROUNDS, COARSE, REACH, LEAST_LAID = 12, 8.0, 4.0, 50
"""Rounds of laying points onto each other; scale of the first round's loss in distances of one place; points farther
apart than so many scales do not count; points without which it stops."""
FACING = 0.7
"""Least cosine between the normals of points that lie on each other."""
NEAR_PX = 2.0
"""Points this near to each other are of one place [px]."""
FEWEST = 200
"""Points on points below which the paint says nothing."""
PATCH = 60
"""Points over which paint is compared at a time: a correlation of so many scatters by 0.13."""
OVERLAP = 0.15
"""Share of the turned points that must lie on measured points."""
TILT_DEG, ANGLE_DEG = 12.0, 5.0
"""By how much the axis may lie off the principal one, since what breaks the symmetry moves that, and the angle off the
whole part of a turn."""
LEAST_ALIKE = 0.2
"""Share of the points on points that must lie on the same paint: one side of four with two ends of their own."""
SLIDES = 16
NEAREST_SLIDE, FARTHEST_SLIDE = 6.0, 40.0
"""How far points are slid along the surface for what chance gives [px]: farther than the texture's colours are averaged,
nearer than the light changes."""
SIGMAS = 4.0
"""Standard deviations of slid paint's share by which that of turned points must exceed it."""
HALF = 0.5
"""Share of the correlation that the paint has with itself, measured twice, above which that of a patch is the same: halfway
between the same and another."""
SHOWS = 0.3
"""Correlation of the paint with itself below which the body has none that is known."""


@dataclass(frozen=True)
class Symmetry:
    """One turn under which some of the body looks the same.

    Attributes:
        fold: sides that look alike; axis: number of the principal axis, 0 to 2.
        R, t: (3, 3), (3,): the turn by one side, x becomes R x + t.
        shape: share of the measured points that lie on measured points after it.
        paint: share of these that lie on the same paint; chance: mean and standard deviation of it for points slid along
            the surface.
        points: (m,) numbers of measured points; alike: (m,) bool, which of them lie on the same paint.
    """

    fold: int
    axis: int
    R: np.ndarray
    t: np.ndarray
    shape: float
    paint: float
    chance: tuple[float, float]
    points: np.ndarray
    alike: np.ndarray

    def turns(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """All turns (R, t) but none at all."""
        out = [(self.R, self.t)]
        while len(out) < self.fold - 1:
            R, t = out[-1]
            out.append((self.R @ R, self.R @ t + self.t))
        return out


def symmetries(
    cloud: Cloud, colour: np.ndarray, centre: np.ndarray, axes: np.ndarray, pixel: float, seed: int = 0
) -> list[Symmetry]:
    """The turn with most sides about each principal axis under which shape and paint repeat; none without paint.

    Args:
        cloud: measured points; colour: (n, 3) uint8 theirs.
        centre: (3,) centre of mass; axes: (3, 3) principal axes as columns.
        pixel: size of a pixel at the body [units of the cloud].
        seed: of the points drawn.
    """
    if len(cloud) < 2 * FEWEST:
        return []
    body = _Painted(cloud, colour, pixel, np.random.default_rng([seed, 41]))
    if not body.own > SHOWS:
        return []
    turns = []
    for axis in range(3):
        for fold in FOLDS:
            one = body.turned(axis, fold, axes[:, axis], centre)
            if one is not None:
                turns.append(one)
                break
    return turns


class _Painted:
    """The measured points, ready to be turned."""

    def __init__(self, cloud: Cloud, colour: np.ndarray, pixel: float, rng: np.random.Generator) -> None:
        from scipy.spatial import cKDTree

        self.xyz, self.normal = np.asarray(cloud.xyz, float), np.asarray(cloud.normal, float)
        self.near, self.rng = NEAR_PX * pixel, rng
        self.pixel, self.tree = pixel, cKDTree(self.xyz)
        self.pick = np.sort(rng.permutation(len(self.xyz))[:SAMPLED])
        self.colour = colour
        half = rng.random(len(self.xyz)) < 0.5
        one, other = (texture(self.xyz[h], colour[h], self.xyz[self.pick]) for h in (half, ~half))
        self.own = correlation(one, other)

    def on(self, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which of the points x (m, 3) with normals n lie on measured points, and on which (m,)."""
        away, index = self._nearest(x, self.near)
        return (away < self.near) & (np.einsum("ij,ij->i", self.normal[index], n) > FACING), index

    def _nearest(self, x: np.ndarray, within: float) -> tuple[np.ndarray, np.ndarray]:
        """Distances (m,) and numbers (m,) of the measured points nearest to x (m, 3); beyond `within` infinite, and any number."""
        # the search may end a little farther out: what lies just within is in it, however it is rounded
        away, index = self.tree.query(x, distance_upper_bound=1.001 * within)
        return away, np.where(np.isfinite(away), index, 0)

    def paint(self, index: np.ndarray) -> np.ndarray:
        """(m, 3) what is painted at measured points."""
        return texture(self.xyz, self.colour, self.xyz[index], self.tree)

    def turned(self, number: int, fold: int, axis: np.ndarray, centre: np.ndarray) -> Symmetry | None:
        """The turn by one of `fold` sides, where the body looks the same after it."""
        R = _rotation(axis, 2 * np.pi / fold)
        R, t = self.laid(R, centre - R @ centre)
        if not _is_turn(R, axis, fold):
            return None
        x, n = self.xyz[self.pick] @ R.T + t, self.normal[self.pick] @ R.T
        good, index = self.on(x, n)
        if good.sum() < FEWEST or good.mean() < OVERLAP:
            return None
        here, there = self.pick[good], index[good]
        patch, mine = _patches(self.xyz[here], self.normal[here], PATCH), self.paint(here)
        same = self.same(mine, self.paint(there), patch)
        if not same.mean() > LEAST_ALIKE:
            return None
        chance = self.chance(mine, there, patch)
        if not same.mean() > chance[0] + SIGMAS * chance[1]:
            return None
        alike = np.zeros(len(self.pick), bool)
        alike[good] = same
        return Symmetry(
            fold=fold,
            axis=number,
            R=R,
            t=t,
            shape=float(good.mean()),
            paint=float(same.mean()),
            chance=chance,
            points=self.pick,
            alike=alike,
        )

    def same(self, one: np.ndarray, other: np.ndarray, patch: np.ndarray) -> np.ndarray:
        """(m,) bool: the paints (m, 3) are the same in the patch (m,) of a point."""
        out = np.zeros(len(patch), bool)
        for k in range(patch.max(initial=-1) + 1):
            in_patch = patch == k
            out[in_patch] = (
                in_patch.sum() > PATCH // 4 and correlation(one[in_patch], other[in_patch]) > HALF * self.own
            )
        return out

    def laid(self, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The turned points laid onto the measured ones, what does not lie there counting less with every round."""
        some = self.pick[:: max(1, len(self.pick) // LAID)]
        for scale in self.near * np.geomspace(COARSE, 0.5, ROUNDS):
            x, n = self.xyz[some] @ R.T + t, self.normal[some] @ R.T
            away, index = self._nearest(x, REACH * scale)
            use = (np.einsum("ij,ij->i", self.normal[index], n) > FACING) & (away < REACH * scale)
            if use.sum() < LEAST_LAID:
                break
            p, m = x[use], self.normal[index[use]]
            off = np.einsum("ij,ij->i", p - self.xyz[index[use]], m)
            about, weight = p.mean(0), 1.0 / np.sqrt(1.0 + (off / scale) ** 2)
            rows = np.column_stack([np.cross(p - about, m), m])
            step = np.linalg.lstsq(rows * weight[:, None], -off * weight, rcond=1e-6)[0]
            turn = _rotation(step[:3], float(np.linalg.norm(step[:3])))
            R, t = turn @ R, turn @ (t - about) + about + step[3:]
        return R, t

    def chance(self, mine: np.ndarray, there: np.ndarray, patch: np.ndarray) -> tuple[float, float]:
        """Mean and standard deviation of the share of paint (m, 3) that is the same beside the points `there` (m,)."""
        values = []
        for _ in range(SLIDES):
            shift = self.rng.standard_normal(3)
            n = self.normal[there]
            along = shift - (n @ shift)[:, None] * n
            along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
            far = self.rng.uniform(NEAREST_SLIDE, FARTHEST_SLIDE) * self.pixel
            good, index = self.on(self.xyz[there] + far * along, n)
            if good.sum() >= FEWEST // 2:
                values.append(self.same(mine[good], self.paint(index[good]), patch[good]).mean())
        return (float(np.mean(values)), float(np.std(values))) if len(values) > 2 else (0.0, 1.0)


def _patches(xyz: np.ndarray, normal: np.ndarray, size: int) -> np.ndarray:
    """(m,) number of the patch of each point, of about `size` points that lie together and face alike."""
    from scipy.spatial import cKDTree

    place = np.column_stack([xyz, 0.5 * np.ptp(xyz, axis=0).max() * normal])
    seeds = place[:: max(1, size)]
    return np.asarray(cKDTree(seeds).query(place)[1], int)


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    length = float(np.linalg.norm(axis))
    turn = axis * (angle / length) if length > 0 else np.zeros(3)
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def _is_turn(R: np.ndarray, axis: np.ndarray, fold: int) -> bool:
    """Whether a rotation is still one by a `fold`-th of a turn about the axis."""
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(R).as_rotvec()
    angle = float(np.linalg.norm(vector))
    cosine = abs(float(vector @ axis)) / max(angle * float(np.linalg.norm(axis)), 1e-12)
    return bool(cosine > np.cos(np.radians(TILT_DEG)) and abs(np.degrees(angle) - 360.0 / fold) < ANGLE_DEG)
