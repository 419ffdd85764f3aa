"""Ways of laying one placement onto another: turns tried over the whole sphere, and fitted to silhouettes and surfaces.

Where both saw the same side, their points must lie on each other (trimmed point-to-plane ICP: Chen and Medioni 1992;
Chetverikov and others 2005) and have the same paint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.geometry import vectors
from massprops.surface.coherence import Pair, Witnesses, moved
from massprops.surface.paint import PAINTED, correlation, paint_shown, texture
from massprops.surface.placed import Placed, picked
from massprops.surface.tangents import touching_shifts

TRIED, FITTED, KEPT = 12_000, 120, 40
"""Turns scored, those of them that are fitted to the silhouettes, and the different answers that are refined."""
FEW, POINTS = 200, 400
"""Rim rays of each placement that every turn is scored with; points beside them."""
ALIKE_DEG = 4.0
"""Answers nearer than this to a better one are the same."""
APART_DEG = 20.0
"""Rotations nearer than this to each other are one answer."""
CLEAR = 1.5
"""How many times worse than the best the next rotation must be."""
APART_PX = 0.05
"""And by how many pixels: no outline is known better."""
COMMON = 0.1
"""Share of a placement's points that must face what the other measured for what both measured to say anything. Of a photographed
stamp the relief below and the rims above were measured in one placement each: a few points laid onto each other all the same
moved it by 1.2 degrees, from .84 to 1.16 px outside the outlines."""
SLACK = 3.0
"""1-sigma of a turn or shift over the amount at which an answer becomes clearly worse. Of scissors, a padlock and a screwdriver
laid by their outlines (Blender) the true errors were 0.03 to 0.8 of that amount, 0.29 in the root mean square."""
SLACK_STEP, SLACK_STEPS = 1.3, 20
"""Factor between the amounts tried, from one pixel at the object's rim on, and how many of them."""
SAME_PX, OTHER_SHARE = 2.0, 0.03
"""Two answers are one body where the silhouettes say so and all but this share of the points of either lie within so many
pixels of the other; points that are not on their own placement's shape do not count, nor as many again. Of a flower pot
that was turned by 30 to 180 degrees about its axis 84 to 92 % lay there, and 93 % on its own shape."""


def worse(outside_px: float) -> float:
    """The distance [px] from which an answer is clearly worse than one of this distance."""
    return max(CLEAR * outside_px, outside_px + APART_PX)


@dataclass(frozen=True, eq=False)
class Answer:
    """A rotation and shift, how far outside [px], and the paint's correlation."""

    R: np.ndarray
    t: np.ndarray
    outside: float
    colour: float = 0.0

    def away(self, other: Answer) -> float:
        """Angle between two answers [deg]."""
        return vectors.turn_deg(self.R, other.R)


def outlines_of(first: Placed, second: Placed, rng: np.random.Generator) -> Pair:
    """What the outlines of either placement say of the other."""
    return Pair(first.extent, second.extent, _witnesses(first, rng), _witnesses(second, rng))


def _witnesses(side: Placed, rng: np.random.Generator) -> Witnesses:
    """A placement's rim rays, and some of its measured points."""
    xyz = picked(side.cloud.xyz, POINTS, rng)
    start = np.concatenate([side.rims.start, side.rims.start[-1] + 1 + np.arange(len(xyz))])
    return Witnesses(np.concatenate([side.rims.xyz, xyz]), start)


class PlacementPair:
    """Two placements, ready to be laid onto each other."""

    def __init__(self, first: Placed, second: Placed, rng: np.random.Generator) -> None:
        from scipy.spatial import cKDTree

        self.first, self.second, self.rng = first, second, rng
        self.outlines = outlines_of(first, second, rng)
        self.xyz, self.normal = first.cloud.xyz, first.cloud.normal
        self.bodies = [cKDTree(np.concatenate([p.cloud.xyz, p.shape])) for p in (first, second)]
        apart = np.median(cKDTree(second.shape).query(second.shape, k=2)[0][:, 1])
        self.tolerance = max(SAME_PX * first.pixel, 2.0 * float(apart))
        self.tree = cKDTree(self.xyz)
        pick = np.sort(rng.permutation(len(second.cloud))[:1500])
        self.moving, self.facing = second.cloud.xyz[pick], second.cloud.normal[pick]
        wrong = np.mean(cKDTree(second.shape).query(self.moving)[0] > self.tolerance)
        self.least_agreement = 1.0 - OTHER_SHARE - 2.0 * float(wrong)
        shown = np.sort(rng.permutation(len(second.cloud))[:PAINTED])
        self.shown, self.shown_facing = second.cloud.xyz[shown], second.cloud.normal[shown]
        self.colours = texture(self.xyz, first.colour, self.xyz)
        self.own = texture(second.cloud.xyz, second.colour, self.shown)
        self.same: dict[tuple[bytes, ...], bool] = {}

    def answers(self) -> list[Answer]:
        """Ways of laying the second placement onto the first, in the order of their silhouettes."""
        from scipy.spatial.transform import Rotation

        few = self.outlines.some(FEW, self.rng)
        middle = self.second.middle
        turns = Rotation.random(TRIED, rng=self.rng).as_matrix()
        shifts, scores = self.shifts(turns, few)
        order = np.argsort(scores, kind="stable")
        fitted_poses = [few.fitted(turns[k], shifts[k], middle) for k in order[:FITTED]]
        kept: list[Answer] = []
        for a in sorted((Answer(R, t, few.score(R, t)) for R, t in fitted_poses), key=lambda a: a.outside):
            if all(a.away(b) > ALIKE_DEG for b in kept):
                kept.append(a)
        return sorted((self.refined(a) for a in kept[:KEPT]), key=lambda a: a.outside)

    def shifts(self, turns: np.ndarray, few: Pair) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) for each turn (n, 3, 3) the shift that a few witnesses bear best, of three: by the middles of the first shapes, and by the
        planes that touch the one and the other; and (n,) the scores by these witnesses.

        Of a photographed stamp the middles lie apart by three quarters of its size, as a shape of seven images lacks the handle: with
        them alone none of eight seeds found the true turn, with the planes all do.
        """
        back = np.swapaxes(turns, 1, 2)
        first, second = (side.extent.corners() for side in (self.first, self.second))
        there = touching_shifts(back, self.first.tangents, second)
        tried = np.stack(
            [
                self.first.middle - turns @ self.second.middle,
                touching_shifts(turns, self.second.tangents, first),
                -np.einsum("nij,nj->ni", turns, there),
            ]
        )
        scores = np.stack([few.scores(turns, t) for t in tried])
        best = np.argmin(scores, axis=0), np.arange(len(turns))
        return tried[best], scores[best]

    def refined(self, answer: Answer) -> Answer:
        """The answer fitted to all silhouettes, and with its surfaces laid onto each other where those bear it."""
        ways = [self.outlines.fitted(answer.R, answer.t, self.second.middle)]
        ways.append(self.laid(*ways[0]))
        by_rims, by_points = (Answer(R, t, self.outlines.score(R, t), self.colour(R, t)) for R, t in ways)
        return by_points if by_points.outside < worse(by_rims.outside) else by_rims

    def colour(self, R: np.ndarray, t: np.ndarray) -> float:
        """Mean correlation of the three channels over points that both placements saw; 0 where they are few."""
        x, n = self.shown @ R.T + t, self.shown_facing @ R.T
        away, index = self.tree.query(x)
        alike = np.einsum("ij,ij->i", self.normal[index], n) > 0.5
        if alike.sum() < COMMON * len(x):
            return 0.0
        use = alike & (away <= np.quantile(away[alike], 0.5))
        return correlation(self.colours[index[use]], self.own[use])

    def by_photographs(self, answer: Answer) -> Answer:
        """The answer with the paint's correlation between each placement's points and the other's photographs of them."""
        back = answer.R.T
        ways = ((self.first, self.second, back, -back @ answer.t), (self.second, self.first, answer.R, answer.t))
        correlations = [paint_shown(a, b, R, t, self.rng) for a, b, R, t in ways]
        seen = sum(n for n, _ in correlations)
        return replace(answer, colour=sum(n * c for n, c in correlations) / seen if seen else 0.0)

    def covariance(self, answer: Answer) -> np.ndarray:
        """(6, 6) of a small turn about the second placement's middle and of a shift, from how far the outlines let it move."""
        R, t = answer.R, answer.t
        about = R @ self.second.middle + t
        x = self.second.shape @ R.T + t - about
        axes = np.linalg.svd(x, full_matrices=False)[2]
        pixel = self.first.pixel
        steps = np.concatenate([np.full(3, pixel / np.linalg.norm(x, axis=1).max()), np.full(3, pixel)])
        limit = worse(self.outlines.score(R, t))
        sigma = np.zeros(6)
        for k, step in enumerate(np.kron(np.eye(2), axes)):
            for way in (steps[k] * step, -steps[k] * step):
                tried = (SLACK_STEP**n for n in range(SLACK_STEPS))
                far = (f for f in tried if self.outlines.score(*moved(R, t, about, f * way)) > limit)
                sigma[k] += 0.5 * steps[k] * next(far, SLACK_STEP**SLACK_STEPS) / SLACK
        # a turn that no outline tells gives the same body
        sigma[:3] = np.minimum(sigma[:3], np.deg2rad(APART_DEG) / 2)
        turned = np.kron(np.eye(2), axes.T)
        return np.asarray(turned @ np.diag(sigma**2) @ turned.T)

    def one_body(self, one: Answer, other: Answer) -> bool:
        """Whether two ways of laying the second placement onto the first make the same body.

        They do where either placement looks the same to itself when it is turned from the one to the other. The side that a
        placement stood on belongs to it as its first shape closes it. It is asked with each kind of paint, which changes nothing
        of it, so that what was found is kept.
        """
        key = tuple(x.tobytes() for x in (one.R, one.t, other.R, other.t))
        if key not in self.same:
            self.same[key] = self._one_body(one, other)
        return self.same[key]

    def _one_body(self, one: Answer, other: Answer) -> bool:
        """What `one_body` says."""
        across, back = other.R @ one.R.T, one.R.T @ other.R
        ways = ((self.first, across, other.t - across @ one.t), (self.second, back, one.R.T @ (other.t - one.t)))
        if not any(side.rims.rim_error(side.extent, R, t) < worse(side.rim_error) for side, R, t in ways):
            return False
        first, second = self.bodies
        near = {"distance_upper_bound": 2 * self.tolerance}
        for a, b in ((one, other), (other, one)):
            x = self.moving @ a.R.T + a.t
            away = np.minimum(first.query(x, **near)[0], second.query((x - b.t) @ b.R, **near)[0])
            if np.mean(away < self.tolerance) < self.least_agreement:
                return False
        return True

    def laid(self, R: np.ndarray, t: np.ndarray, rounds: int = 40) -> tuple[np.ndarray, np.ndarray]:
        """Trimmed point-to-plane ICP, held by the silhouettes: the closest half of the points that face alike decide."""
        for _ in range(rounds):
            x, n = self.moving @ R.T + t, self.facing @ R.T
            away, index = self.tree.query(x)
            alike = np.einsum("ij,ij->i", self.normal[index], n) > 0.5
            if alike.sum() < COMMON * len(x):
                break
            use = alike & (away <= np.quantile(away[alike], 0.5))
            p, q, m = x[use], self.xyz[index[use]], self.normal[index[use]]
            about = R @ self.second.middle + t
            beside = np.einsum("ij,ij->i", p - q, m) / self.first.pixel
            slope = np.column_stack([np.cross(p - about, m), m]) / self.first.pixel
            out, fall = self.outlines.rows(R, t, about)
            rows, values = np.concatenate([slope, fall]), np.concatenate([beside, out])
            # so that each kind counts by the mean of its distances
            count = np.repeat([len(beside), len(out)], [len(beside), len(out)])
            weight = 1.0 / (count * np.maximum(np.abs(values), 1.0))
            unit = np.array([1.0, 1, 1, *np.full(3, self.first.extent.size)])
            rows = rows * unit
            normal = rows.T @ (weight[:, None] * rows)
            step = -np.linalg.lstsq(normal, rows.T @ (weight * values), rcond=1e-6)[0] * unit
            R, t = moved(R, t, about, step)
            if np.linalg.norm(step[:3]) < 1e-6:
                break
        return R, t
