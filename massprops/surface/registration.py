"""Two placements of one rigid body laid onto each other by its shape and its silhouettes, without features.

Small glossy things have too few features in common. But the measured points of each placement must fall inside the
silhouettes of the other, and where both saw the same side, their points must lie on each other. Rotations are tried over
the whole sphere, scored by the silhouettes, refined by trimmed point-to-plane ICP (Chen and Medioni 1992; Chetverikov
and others 2005), and scored again; the best must be clearly better than every other rotation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit

from massprops.surface.cloud import Cloud
from massprops.surface.silhouette import Hull, _distance, _view

TRIED, REFINED = 2000, 60
"""Rotations scored, and those of them that are refined."""
POINTS = 400
"""Points of each placement that are scored."""
MOST = 25.0
"""A point farther outside than this counts no more [px]."""
APART_DEG = 20.0
"""Rotations nearer than this to each other are one answer."""
CLEAR = 1.5
"""How many times worse than the best the next rotation must be."""
POLISHED, TURN, SHIFT = 1000, 0.05, 0.02
"""Points of each placement that the last refinement scores, and its first steps [rad] and [of the object's size]."""
APART_PX = 0.05
"""And by how many pixels: no outline is known better."""
PAINTED, FINE, COARSE = 6000, 4, 150
"""Points at which paint is compared, those over which colours are averaged, and those over which the light is taken to be
the same. Fine paint tells more: on a rendered tin turned over, the right answer's correlation stood 0.9 standard
deviations of the wrong ones above the best of 60 wrong answers with 8 and 200 of 6000 points, 5.6 with 4 and 200 of
30 000, 12 with 2 and 100."""
COLOUR, SURE = 0.1, 2.0
"""Least correlation of the paint that decides, and by how many standard deviations of wrong answers it must exceed any
other answer's."""
LEAST_NOISE = 0.03
"""Smallest standard deviation of wrong answers' paint: of `PAINTED` points at most half lie where both were seen."""
LARGEST = 1.5
"""Mean distance outside [px] above which nothing fits. On two rendered pairs the right answers had 0.56 and 0.68, the best
wrong ones 1.22 and 2.14."""
LARGEST_PAINTED = 4.0
"""The same where the paint decides: shapes lack sides that were badly lit."""
SAME_PX, SAME_SHARE = 2.0, 0.97
"""Two answers are one body where this share of the points of either lies within so many pixels of the other: the
silhouettes know no better (`LARGEST`). A cup, or a plain brick, looks the same however it is turned about its axes."""


@dataclass(frozen=True)
class Placed:
    """One placement: its points (Cloud) and their colours (n, 3), its hull of silhouettes, the middle (3,) of its first
    shape and points (m, 3) all over that, the side it stood on among them."""

    cloud: Cloud
    colour: np.ndarray
    hull: Hull
    middle: np.ndarray
    shape: np.ndarray


@dataclass(frozen=True)
class Registration:
    """How one placement lies in the frame of another.

    Attributes:
        R, t: (3, 3) and (3,): x in the first placement's frame is R x + t of the second's.
        outside_px: mean distance by which points of each fall outside the silhouettes of the other.
        rival_px: the same of the best rotation that is another answer, and makes another body.
        colour: correlation of the colours where both placements saw the surface.
        rival_colour: the largest of the other answers that the silhouettes bear.
        colour_noise: standard deviation of the correlation for answers that are wrong.
    """

    R: np.ndarray
    t: np.ndarray
    outside_px: float
    rival_px: float
    colour: float
    rival_colour: float
    colour_noise: float

    @property
    def painted(self) -> bool:
        """Whether the paint says that it is this one and no other."""
        return self.colour > max(COLOUR, self.rival_colour + SURE * self.colour_noise)

    @property
    def fits(self) -> bool:
        """Whether the silhouettes bear it."""
        return self.outside_px < (LARGEST_PAINTED if self.painted else LARGEST)

    @property
    def clear(self) -> bool:
        """Whether it fits and nothing else does nearly as well, by paint or by shape.

        Shape decides against the paint only where it is much clearer.
        """
        worse = max(CLEAR * self.outside_px, self.outside_px + APART_PX)
        against = self.rival_colour - self.colour
        by_shape = any(self.rival_px > n * worse and against < n * SURE * self.colour_noise for n in (1, 2))
        return self.fits and (self.painted or by_shape)


def register(first: Placed, second: Placed, seed: int = 0) -> Registration:
    """The rotation and shift that carry the second placement onto the first.

    Args:
        first, second: placements in the units of one reconstruction.
        seed: of the rotations and points tried.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng([seed, 31])
    a, b = (_some(p.cloud.xyz, POINTS, rng) for p in (first, second))
    turns = Rotation.random(TRIED, rng=rng).as_matrix()
    shifts = first.middle - turns @ second.middle
    scores = np.array([_outside(R, t, a, b, first, second) for R, t in zip(turns, shifts, strict=True)])
    found = []
    dense = _Pair(first, second, rng)
    for k in np.argsort(scores, kind="stable")[:REFINED]:
        R, t = dense.refined(turns[k], shifts[k])
        found.append((_outside(R, t, a, b, first, second), R, t))
    found.sort(key=lambda f: f[0])
    near = [f for f in found if f[0] < LARGEST_PAINTED]
    rest = np.argsort(scores, kind="stable")[REFINED : 2 * REFINED]
    alike = [dense.colour(R, t) for _, R, t in near]
    # the paint decides where it is clear: shapes may be incomplete, each on the side that was badly lit
    chosen = int(np.argmax(alike)) if near else 0
    others = [c for c, (_, Q, _) in zip(alike, near, strict=True) if _angle(Q, near[chosen][1]) > APART_DEG]
    noise = max(LEAST_NOISE, float(np.std(others)) if others else 0.0)
    other = _best_other(near, alike, near[chosen][1], dense) if near else 0.0
    painted = max(alike, default=0.0) > max(COLOUR, other + SURE * noise)
    _, R, t = near[chosen] if painted else found[0]
    rival_colour = _best_other(near, alike, R, dense)
    more = (_some(p.cloud.xyz, POLISHED, rng) for p in (first, second))
    score = partial(_outside, a=next(more), b=next(more), first=first, second=second)
    laid = dense.refined(R, t, rounds=60)
    R, t = _polished(*laid, score, second.middle, dense.size)
    # outlines know a turn to a degree; paint that matches knows it better
    if dense.colour(*laid) > dense.colour(R, t) + SURE * noise:
        R, t = laid
    best = score(R, t)
    tried = found + [(float(scores[k]), turns[k], shifts[k]) for k in rest]
    rival = np.inf
    for _, Q, u in [f for f in sorted(tried, key=lambda f: f[0]) if _angle(f[1], R) > APART_DEG]:
        Q, u = dense.refined(Q, u, rounds=60)
        if dense.one_body((R, t), (Q, u)):
            continue
        Q, u = _polished(Q, u, score, second.middle, dense.size)
        if _angle(Q, R) > APART_DEG and not dense.one_body((R, t), (Q, u)):
            rival = score(Q, u)
            break
    return Registration(R, t, best, rival, dense.colour(R, t), rival_colour, noise)


def _best_other(
    near: list[tuple[float, np.ndarray, np.ndarray]], alike: list[float], R: np.ndarray, dense: _Pair
) -> float:
    """The best paint (`alike`) of the answers `near` (outside [px], R, t) that stay others when they are refined to the
    end; 0 at least."""
    for k in np.argsort(alike)[::-1]:
        _, Q, u = near[k]
        if _angle(Q, R) > APART_DEG and _angle(dense.refined(Q, u, rounds=60)[0], R) > APART_DEG:
            return max(0.0, alike[k])
    return 0.0


def _polished(
    R: np.ndarray, t: np.ndarray, score: Callable[[np.ndarray, np.ndarray], float], middle: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """The rotation and shift near these that the silhouettes bear best (Powell 1964).

    Glossy sides are measured badly, and few points lie on the same side in both placements: ICP alone left 2.5 degrees.
    """
    from scipy.optimize import minimize
    from scipy.spatial.transform import Rotation

    def moved(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        Q = Rotation.from_rotvec(TURN * x[:3]).as_matrix() @ R
        return Q, R @ middle + t + SHIFT * size * x[3:] - Q @ middle

    best = minimize(lambda x: score(*moved(x)), np.zeros(6), method="Powell", options={"maxfev": 300, "ftol": 1e-3})
    return moved(best.x) if best.fun < score(R, t) else (R, t)


def _some(xyz: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return np.ascontiguousarray(xyz[np.sort(rng.permutation(len(xyz))[:most])])


def _angle(P: np.ndarray, Q: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(P.T @ Q) - 1) / 2, -1, 1))))


def _outside(R: np.ndarray, t: np.ndarray, a: np.ndarray, b: np.ndarray, first: Placed, second: Placed) -> float:
    """Mean distance [px] of points outside the silhouettes of the other placement."""
    here = _mean_outside(np.ascontiguousarray(b @ R.T + t), first.hull.maps, first.hull.size, first.hull.P, MOST)
    there = _mean_outside(np.ascontiguousarray((a - t) @ R), second.hull.maps, second.hull.size, second.hull.P, MOST)
    return 0.5 * (here + there)


@njit(cache=True, error_model="numpy")
def _mean_outside(xyz, maps, size, P, most):  # type: ignore[no-untyped-def]
    total, count = 0.0, 0
    for v in range(len(P)):
        view = _view(maps, size, P, v)
        for i in range(len(xyz)):
            d = _distance(view, xyz[i, 0], xyz[i, 1], xyz[i, 2])
            if np.isnan(d):
                d = most
            total += min(max(d, 0.0), most)
            count += 1
    return total / max(count, 1)


def texture(xyz: np.ndarray, colour: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m, 3) logarithm of the colour over that of the surroundings: what is painted, not how it is lit.

    The lamp stays where it is when the object is turned, so that light and shade would join the wrong sides.

    Args:
        xyz, colour: (n, 3) points; at: (m, 3) where it is wanted.
    """
    from scipy.spatial import cKDTree

    near = cKDTree(xyz).query(at, k=min(COARSE, len(xyz)))[1]
    levels = [np.log(colour[near[:, :k]].mean(1, dtype=float) + 4.0) for k in (FINE, COARSE)]
    return np.asarray(levels[0] - levels[1])


class _Pair:
    """Points of two placements, ready for ICP."""

    def __init__(self, first: Placed, second: Placed, rng: np.random.Generator) -> None:
        from scipy.spatial import cKDTree

        self.xyz, self.normal = first.cloud.xyz, first.cloud.normal
        self.first, self.second = (cKDTree(np.concatenate([p.cloud.xyz, p.shape])) for p in (first, second))
        apart = np.median(cKDTree(second.shape).query(second.shape, k=2)[0][:, 1])
        self.size = float(np.ptp(self.xyz, axis=0).max())
        self.tolerance = max(SAME_PX * first.hull.pixel, 2.0 * float(apart))
        self.tree = cKDTree(self.xyz)
        pick = np.sort(rng.permutation(len(second.cloud))[:1500])
        self.moving, self.facing = second.cloud.xyz[pick], second.cloud.normal[pick]
        shown = np.sort(rng.permutation(len(second.cloud))[:PAINTED])
        self.shown, self.shown_facing = second.cloud.xyz[shown], second.cloud.normal[shown]
        self.colours = texture(self.xyz, first.colour, self.xyz)
        self.own = texture(second.cloud.xyz, second.colour, self.shown)

    def colour(self, R: np.ndarray, t: np.ndarray) -> float:
        """Mean correlation of the three channels over points that both placements saw; 0 where they are few."""
        x, n = self.shown @ R.T + t, self.shown_facing @ R.T
        away, index = self.tree.query(x)
        alike = np.einsum("ij,ij->i", self.normal[index], n) > 0.5
        if alike.sum() < 0.1 * len(x):
            return 0.0
        use = alike & (away <= np.quantile(away[alike], 0.5))
        theirs, own = self.colours[index[use]], self.own[use]
        spread = theirs.std(0) * own.std(0)
        covariance = ((theirs - theirs.mean(0)) * (own - own.mean(0))).mean(0)
        return float(np.mean(covariance / np.maximum(spread, 1e-9)))

    def one_body(self, one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> bool:
        """Whether two ways (R, t) of laying the second placement onto the first make the same body.

        The side that a placement stood on belongs to it as its first shape closes it.
        """
        for (R, t), (Q, u) in ((one, other), (other, one)):
            x = self.moving @ R.T + t
            away = np.minimum(self.first.query(x)[0], self.second.query((x - u) @ Q)[0])
            if np.mean(away < self.tolerance) < SAME_SHARE:
                return False
        return True

    def refined(self, R: np.ndarray, t: np.ndarray, rounds: int = 15) -> tuple[np.ndarray, np.ndarray]:
        """Trimmed point-to-plane ICP: the closest half of the points that face alike decide."""
        from scipy.spatial.transform import Rotation

        for _ in range(rounds):
            x, n = self.moving @ R.T + t, self.facing @ R.T
            away, index = self.tree.query(x)
            alike = np.einsum("ij,ij->i", self.normal[index], n) > 0.5
            if alike.sum() < 50:
                break
            use = alike & (away <= np.quantile(away[alike], 0.5))
            p, q, m = x[use], self.xyz[index[use]], self.normal[index[use]]
            middle = p.mean(0)
            rows = np.column_stack([np.cross(p - middle, m), m])
            right = np.einsum("ij,ij->i", q - p, m)
            step = np.linalg.lstsq(rows, right, rcond=1e-6)[0]
            turn = Rotation.from_rotvec(step[:3]).as_matrix()
            R, t = turn @ R, turn @ (t - middle) + middle + step[3:]
            if np.linalg.norm(step[:3]) < 1e-6:
                break
        return R, t
