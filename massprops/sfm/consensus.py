"""Whether candidate places agree on how one model lies on another, and how.

Each candidate says: this point of the one model is seen at this place in that image of the other. Most are wrong. Those
that are right agree on one small turn, change of size and shift. It is found on half of the points and tried on the other
half. A placement is believed where the points set aside agree with it as by chance less than once in a million times, and more
of them than with placements that are wrong by much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from massprops.sfm.points import SparsePoints, projected
from massprops.views import Views

AGREES_PX = 2.0
"""Distance within which a candidate agrees with a placement."""

FIRST_PX = 5.0
"""Width of the score at the start of the search, so that it has a slope to climb."""

DRAWS, ROUNDS, BEST = 1500, 9, 40
"""Placements drawn in each round of the search (cross-entropy method, Rubinstein 1999), rounds, and how many of the best make
the next round's mean and spread."""

WRONG = 200
"""Placements drawn to see how many candidates agree with one by chance."""

CHANCE = 1e-6
"""Probability that the points set aside agree so by chance up to which a placement is believed."""

STANDS_OUT, TOGETHER_BY_TWOS = 1e-3, 2.0
"""The same beside placements that are wrong by much, of which each has its own best agreement; neighbouring points agree by
twos. Right placements of a cratered body and a spacecraft, 0.10 to 0.73 of the points: 1e-4 and less; wrong ones, 0.06 of the points in
the mean: 0.03 and more."""

TOGETHER = 9.0
"""Candidates that count as one beside what is thought: those that follow the light are wrong together."""

LEAST_POINTS = 15
"""Points that must agree, as those of an image."""


class Candidates(NamedTuple):
    """n places uv (n, 2) [px] in views (n,) at which points (n,) may be seen."""

    point: np.ndarray
    view: np.ndarray
    uv: np.ndarray

    @staticmethod
    def joined(parts: list[Candidates]) -> Candidates:
        """All of them."""
        return Candidates(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def some(self, most: int, rng: np.random.Generator) -> Candidates:
        """Those of at most so many points, by draw."""
        points = np.unique(self.point)
        return self.take(np.flatnonzero(np.isin(self.point, rng.permutation(points)[:most])))

    def take(self, index: np.ndarray) -> Candidates:
        """Those at `index`."""
        return Candidates(self.point[index], self.view[index], self.uv[index])


@dataclass(frozen=True)
class Spread:
    """Standard deviations of where the second model lies, about what is thought: turn [rad], logarithm of its size, shift."""

    turn: float
    size: float
    shift: float

    @property
    def sigma(self) -> np.ndarray:
        """(7,) of turn, size and shift."""
        return np.array([*[self.turn] * 3, self.size, *[self.shift] * 3])


@dataclass(frozen=True)
class Agreement:
    """What the candidates agree on: the second model moved by x -> scale R x + t; of n candidates, which agree (n,) bool; points
    set aside, how many of them agree, and how many would by chance; logarithm of the probability of that."""

    scale: float
    R: np.ndarray
    t: np.ndarray
    agree: np.ndarray
    tried: int
    found: int
    chance: float
    log_p: float

    @property
    def beyond_chance(self) -> bool:
        """Whether it is no chance."""
        return self.log_p < np.log(CHANCE) and self.found >= LEAST_POINTS // 2


def is_significant(found: Agreement, wrong: Sequence[Agreement | None]) -> bool:
    """Whether more points agree than with placements that are wrong by much.

    A wrong placement has a best agreement too: neighbouring points are drawn to the same wrong place. Chance alone does not
    know of that.

    Args:
        wrong: agreements of wrong placements; None of those with too few candidates.
    """
    compared = [w for w in wrong if w is not None]
    tried = sum(w.tried for w in compared)
    by_chance = found.chance / max(found.tried, 1)
    share = max(sum(w.found for w in compared) / tried, by_chance) if tried else by_chance
    n, k = found.tried / TOGETHER_BY_TWOS, found.found / TOGETHER_BY_TWOS
    return bool(_log_tail(round(n), round(k), share * round(n)) < np.log(STANDS_OUT))


def agreement(
    views: Views,
    points: SparsePoints,
    second: np.ndarray,
    candidates: Candidates,
    spread: Spread,
    rng: np.random.Generator,
) -> Agreement | None:
    """The placement that most candidates agree on; None of too few.

    Args:
        second: (n,) bool, views of the second model; candidates are points of either seen in views of the other.
    """
    if len(np.unique(candidates.point)) < LEAST_POINTS:
        return None
    middle = np.median(points.xyz, axis=0)
    slope, off = _linear(views, points, second, candidates, middle)
    half = _halves(candidates.point, rng)
    tries = []
    for fit, test in ((half, ~half), (~half, half)):
        x = _climb(slope[fit], off[fit], spread, rng)
        tries.append((_agreeing(slope[test], off[test], x), test))
    wrong = spread.sigma * rng.standard_normal((WRONG, 7))
    tried = agreed = 0
    chance = 0.0
    for agree, test in tries:
        tested = candidates.point[test]
        tried += len(np.unique(tested))
        agreed += len(np.unique(tested[agree]))
        chance += float(np.mean([len(np.unique(tested[_agreeing(slope[test], off[test], w)])) for w in wrong]))
    x = _climb(slope, off, spread, rng)
    R, scale = _turn(x[:3]), float(np.exp(x[3]))
    return Agreement(
        scale=scale,
        R=R,
        t=middle + x[4:] - scale * R @ middle,
        agree=_agreeing(slope, off, x),
        tried=tried,
        found=agreed,
        chance=chance,
        log_p=_log_tail(tried, agreed, chance),
    )


def _halves(point: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) bool: candidates of half of the points, by draw."""
    names, number = np.unique(point, return_inverse=True)
    return (rng.permutation(len(names)) < len(names) / 2)[number]


def _log_tail(tried: int, found: int, chance: float) -> float:
    """Logarithm of the probability that so many of those tried agree, where each does by chance."""
    from scipy.stats import binom

    return float(binom.logsf(found - 1, tried, min(max(chance, 0.5) / max(tried, 1), 1.0)))


def _turn(x: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(x).as_matrix()


def _linear(
    views: Views, points: SparsePoints, second: np.ndarray, candidates: Candidates, middle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (n, 2, 7) of where the points fall by turn, size and shift of the second model about the middle, and how far
    off (n, 2) they are thought to be."""
    v, xyz = candidates.view, points.xyz[candidates.point]
    # a view of the second model that moves is a point of the first that moves the other way
    sign = np.where(second[v], -1.0, 1.0)[:, None]

    def seen(x: np.ndarray) -> np.ndarray:
        return projected(views, v, x)

    d = xyz - middle
    directions = [*(np.cross(e, d) for e in np.eye(3)), d, *(np.tile(e, (len(d), 1)) for e in np.eye(3))]
    step = 1e-4
    slope = [(seen(xyz + step * sign * w) - seen(xyz - step * sign * w)) / (2 * step) for w in directions]
    return np.stack(slope, axis=2), candidates.uv - seen(xyz)


def _agreeing(slope: np.ndarray, off: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.linalg.norm(off - slope @ x, axis=1) < AGREES_PX


def _climb(slope: np.ndarray, off: np.ndarray, spread: Spread, rng: np.random.Generator) -> np.ndarray:
    """(7,) the placement of the best score, then fitted to the candidates that agree with it."""
    mean, sigma = np.zeros(7), spread.sigma
    for width in np.geomspace(FIRST_PX, 0.5 * AGREES_PX, ROUNDS):
        x = mean + sigma * rng.standard_normal((DRAWS, 7))
        x[0] = mean
        away = ((off[None] - np.einsum("nij,mj->mni", slope, x)) ** 2).sum(2)
        score = np.exp(-away / (2 * width**2)).sum(1) - 0.5 * ((x / spread.sigma) ** 2).sum(1)
        best = x[np.argsort(-score)[:BEST]]
        mean, sigma = best.mean(0), np.maximum(best.std(0), 0.02 * spread.sigma)
    for _ in range(10):
        near = np.exp(-((off - slope @ mean) ** 2).sum(1) / (2 * (0.5 * AGREES_PX) ** 2))
        A = np.einsum("n,nij,nik->jk", near, slope, slope) + TOGETHER * np.diag(1 / spread.sigma**2)
        mean = np.linalg.solve(A, np.einsum("n,nij,ni->j", near, slope, off))
    return mean
