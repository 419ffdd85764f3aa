"""Two placements of one rigid body laid onto each other by its silhouettes, its shape and its paint, without features.

Small glossy things have too few features in common. But the silhouettes of both must be those of one body
(`coherence`): turns are tried over the whole sphere and fitted to the silhouettes and to what each placement stood on.
Where both saw the same side, their points must lie on each other (trimmed point-to-plane ICP: Chen and Medioni 1992;
Chetverikov and others 2005) and have the same paint; where they measured next to nothing in common, the photographs of each
must show the other's paint (`shown`). The best must be clearly better than every other turn, but for those
that make the same body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from massprops.geometry import vectors
from massprops.surface.cloud import Cloud
from massprops.surface.coherence import MOST, TOUCHES, Extent, Pair, Witnesses, extent, moved, rim_rays
from massprops.surface.photo_consistency import Photographs
from massprops.surface.silhouette import make_hull
from massprops.surface.tangents import tangent_planes, touching_shifts
from massprops.views import Views

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

TRIED, FITTED, KEPT = 12_000, 120, 40
"""Turns scored, those of them that are fitted to the silhouettes, and the different answers that are refined."""
FEW, RIMS, POINTS = 200, 800, 400
"""Rim rays of each placement that every turn is scored with, and those of the refinement; points beside them."""
NEED = 3
"""Silhouettes that must agree that a place is empty."""
CANDIDATES = 4
"""Answers that silhouettes, and as many that paint favours, for which features are looked for."""
ALIKE_DEG = 4.0
"""Answers nearer than this to a better one are the same."""
APART_DEG = 20.0
"""Rotations nearer than this to each other are one answer."""
CLEAR = 1.5
"""How many times worse than the best the next rotation must be."""
APART_PX = 0.05
"""And by how many pixels: no outline is known better."""
PAINTED, FINE, COARSE = 6000, 4, 150
"""Points at which paint is compared, those over which colours are averaged, and those over which the light is taken to be
the same. Fine paint tells more: on a rendered tin turned over, the right answer's correlation stood 0.9 standard
deviations of the wrong ones above the best of 60 wrong answers with 8 and 200 of 6000 points, 5.6 with 4 and 200 of
30 000, 12 with 2 and 100."""
COLOUR, AHEAD_SIGMAS = 0.1, 2.0
"""Least correlation of the paint that decides, and by how many standard deviations of wrong answers it must exceed any
other answer's."""
COMMON = 0.1
"""Share of a placement's points that must face what the other measured for what both measured to say anything. Of a photographed
stamp the relief below and the rims above were measured in one placement each: a few points laid onto each other all the same
moved it by 1.2 degrees, from .84 to 1.16 px outside the outlines."""
LEAST_SHOWN = 300
"""Points that the other placement's photographs must show before their paint is compared."""
LEAST_NOISE = 0.03
"""Smallest standard deviation of wrong answers' paint: of `PAINTED` points at most half lie where both were seen."""
LARGEST = 1.5
"""Mean distance outside [px] above which nothing fits."""
LARGEST_PAINTED = 4.0
"""The same where the paint decides: shapes lack sides that were badly lit."""
SLACK = 3.0
"""1-sigma of a turn or shift over the amount at which an answer becomes clearly worse. Of scissors, a padlock and a screwdriver
laid by their outlines (Blender) the true errors were 0.03 to 0.8 of that amount, 0.29 in the root mean square."""
SLACK_STEP, SLACK_STEPS = 1.3, 20
"""Factor between the amounts tried, from one pixel at the object's rim on, and how many of them."""
LOWEST, DOWN = 0.01, 0.1
"""Share of a placement's measured points that lie lower than what it rests on once it is turned over, and least share of them that
must face down, so that this side was measured. At the true turns of five things (Blender) the lowest hundredth lay 1.0 px
above the other's support in the mean, -0.9 to 2.6; a banana laid by its outlines was pushed 5 to 7 px through it."""
SAME_PX, OTHER_SHARE = 2.0, 0.03
"""Two answers are one body where the silhouettes say so and all but this share of the points of either lie within so many
pixels of the other; points that are not on their own placement's shape do not count, nor as many again. Of a flower pot
that was turned by 30 to 180 degrees about its axis 84 to 92 % lay there, and 93 % on its own shape."""


@dataclass(frozen=True)
class Placed:
    """One placement.

    Attributes:
        cloud: its measured points; colour: (n, 3) theirs.
        extent: how far outside its silhouettes and its support every place is.
        rims: the rays along its silhouettes' rims.
        middle: (3,) of its first shape; shape: (m, 3) points all over that, the side it stood on among them.
        pixel: size of a pixel at the object [world units].
        rim_error: mean distance by which its rims miss its own silhouettes [px]: how far these can be relied on.
        photographs: where the other placement's points are looked for, or None.
        support: (4,) plane that it stood on, its normal up, or None.
        tangents: (m, 4) planes that touch the body, of `tangent_planes`.
    """

    cloud: Cloud
    colour: np.ndarray
    extent: Extent
    rims: Witnesses
    middle: np.ndarray
    shape: np.ndarray
    pixel: float
    rim_error: float
    photographs: Photographs | None = None
    support: np.ndarray | None = None
    tangents: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))


def placed(
    cloud: Cloud,
    colour: np.ndarray,
    views: Views,
    masks: list[np.ndarray],
    shape: np.ndarray,
    middle: np.ndarray,
    support: np.ndarray | None,
    seed: int = 0,
) -> Placed:
    """A placement as it can be laid onto another.

    Args:
        cloud, colour: measured points and their colours (n, 3).
        views, masks: its cameras, and (h, w) uint8 silhouettes, undistorted.
        shape: (m, 3) points all over its first shape; middle: (3,) of that.
        support: (4,) plane that it stood on, or None.
        seed: of the rays drawn.
    """
    # points beside the silhouettes must not make these say less
    hull = replace(make_hull(views, masks, cloud.xyz, support=support), need=NEED)
    own = extent(hull, shape)
    rng = np.random.default_rng([seed, 32])
    rims, every = (rim_rays(views, masks, own, RIMS, rng, touches) for touches in (TOUCHES, MOST))
    return Placed(
        cloud=cloud,
        colour=colour,
        extent=own,
        rims=rims,
        middle=middle,
        shape=shape,
        pixel=hull.pixel,
        rim_error=every.rim_error(own),
        support=support,
        tangents=tangent_planes(views, masks),
    )


def with_silhouettes(side: Placed, views: Views, masks: list[np.ndarray], seed: int = 0) -> Placed:
    """A placement as other silhouettes of its views show it, without photographs; arguments as those of `placed`."""
    return placed(side.cloud, side.colour, views, masks, side.shape, side.middle, side.support, seed)


@dataclass(frozen=True)
class Registration:
    """How one placement lies in the frame of another.

    Attributes:
        R, t: (3, 3) and (3,): x in the first placement's frame is R x + t of the second's.
        outside_px: mean distance by which rims and points of each miss the silhouettes of the other.
        rival_px: the same of the best rotation that is another answer, and makes another body.
        colour: correlation of the colours where both placements measured the surface, or where that does not decide, of
            each placement's points with what the other's photographs show there.
        rival_colour: the largest of the other answers that the silhouettes bear.
        colour_noise: standard deviation of the correlation for answers that are wrong.
        symmetric: other rotations make the same body and fit as well.
        own_px: mean distance by which the placements' rims miss their own silhouettes.
        covariance: (6, 6) of a small turn [rad] about where the second placement's middle lies, and a shift.
        candidates: (R, t) of this answer, and of those that paint and silhouettes favour after it.
        turned: the same of the answers that lay the body on another side than in the first placement, where this one lays it on
            the same and fits not clearly better; else None.
        turned_px: as `outside_px`, of the best answer that lays it on another side.
    """

    R: np.ndarray
    t: np.ndarray
    outside_px: float
    rival_px: float
    colour: float
    rival_colour: float
    colour_noise: float
    covariance: np.ndarray
    symmetric: bool = False
    own_px: float = 0.0
    candidates: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    turned: Registration | None = None
    turned_px: float = np.inf

    @property
    def may_be_turned(self) -> bool:
        """Whether the silhouettes bear that the body lies on another side, whatever fits better."""
        return self.turned_px < LARGEST

    @property
    def painted(self) -> bool:
        """Whether the paint says that it is this one and no other."""
        return self.colour > max(COLOUR, self.rival_colour + AHEAD_SIGMAS * self.colour_noise)

    @property
    def fits(self) -> bool:
        """Whether the silhouettes bear it."""
        return self.outside_px < (LARGEST_PAINTED if self.painted else LARGEST)

    @property
    def clear(self) -> bool:
        """Whether it fits and nothing else does nearly as well, by paint or by shape.

        Shape decides against the paint only where it is much clearer, and by more than the silhouettes are wrong.
        """
        against = self.rival_colour - self.colour
        by_shape = any(self._alone(n) and against < n * AHEAD_SIGMAS * self.colour_noise for n in (1, 2))
        return self.fits and (self.painted or by_shape)

    def is_clearly_not(self, R: np.ndarray) -> bool:
        """Whether it is clear, and the turn R (3, 3) is another answer."""
        return self.clear and vectors.turn_deg(R, self.R) > APART_DEG

    @property
    def unpainted(self) -> bool:
        """Whether the shape alone says so, much more clearly than anything else, and the paint says nothing of any turn.

        Of a body of one colour what looks like paint is its relief, which the lamp shows otherwise once the body is turned: what
        was light may be dark then (a plain rock turned over had -0.27, nine times the noise), as paint cannot be.
        """
        return self.fits and self._alone(2) and max(self.colour, self.rival_colour) < AHEAD_SIGMAS * self.colour_noise

    @property
    def by_outlines(self) -> bool:
        """Whether the silhouettes alone say so, much more clearly than anything else."""
        return bool(self.outside_px < LARGEST and self._alone(2))

    def _alone(self, times: float) -> bool:
        """Whether every other answer is as many times worse, silhouettes' own errors counted."""
        return self.rival_px > times * (worse(self.outside_px) + self.own_px)


def worse(outside_px: float) -> float:
    """The distance [px] from which an answer is clearly worse than one of this distance."""
    return max(CLEAR * outside_px, outside_px + APART_PX)


@dataclass(frozen=True, eq=False)
class _Answer:
    """A rotation and shift, how far outside [px], and the paint's correlation."""

    R: np.ndarray
    t: np.ndarray
    outside: float
    colour: float = 0.0

    def away(self, other: _Answer) -> float:
        """Angle between two answers [deg]."""
        return vectors.turn_deg(self.R, other.R)


def register(first: Placed, second: Placed, seed: int = 0) -> Registration:
    """The rotation and shift that carry the second placement onto the first.

    Args:
        first, second: placements in the units of one reconstruction.
        seed: of the rotations and points tried.
    """
    both = _Pair(first, second, np.random.default_rng([seed, 31]))
    answers = both.answers()
    found = _registration(both, answers)
    if found.painted or first.photographs is None or second.photographs is None:
        return found
    # what both measured does not tell: what the photographs of each show of the other's points may
    shown = _registration(both, [both.by_photographs(a) if a.outside < LARGEST_PAINTED else a for a in answers])
    return shown if shown.painted else found


def _registration(both: _Pair, answers: list[_Answer]) -> Registration:
    """The answer that silhouettes and paint favour, and what speaks against the others."""
    first, second = both.first, both.second
    best = _chosen(answers)
    others = [a for a in answers if a.away(best) > APART_DEG]
    noise = _noise(others)
    same = _same_body(both, best, answers)
    alike = [a for a in others if a in same]
    rivals = [a.outside for a in others if a not in alike]
    return Registration(
        R=best.R,
        t=best.t,
        outside_px=best.outside,
        rival_px=min(rivals, default=np.inf),
        colour=best.colour,
        rival_colour=max((a.colour for a in others if a.outside < LARGEST_PAINTED), default=min(best.colour, 0.0)),
        colour_noise=noise,
        covariance=both.covariance(best),
        symmetric=any(a.outside < worse(best.outside) for a in alike),
        own_px=0.5 * (first.rim_error + second.rim_error),
        candidates=_candidates(best, answers),
        turned=_turned(both, best, answers),
        turned_px=min((a.outside for a in answers if not same_side(first, second, a.R)), default=np.inf),
    )


def _same_body(both: _Pair, best: _Answer, answers: list[_Answer]) -> list[_Answer]:
    """The answers that make the same body as the best, or as one of these that fits as well.

    A body of revolution can be turned by any angle. By a small one it is seen to stay the same; by a large one two parts of it lie
    on each other that were measured in one placement each.
    """
    found, todo = [], [best]
    left = [a for a in answers if a is not best]
    while todo:
        one = todo.pop()
        more = [a for a in left if both.one_body(one, a)]
        left = [a for a in left if a not in more]
        todo += [a for a in more if a.outside < worse(best.outside)]
        found += more
    return found


def _turned(both: _Pair, best: _Answer, answers: list[_Answer]) -> Registration | None:
    """The registration by the answers that lay the body on another side, where that taken does not and is no better."""
    first, second = both.first, both.second
    if not same_side(first, second, best.R):
        return None
    others = [a for a in answers if not same_side(first, second, a.R)]
    if not any(a.outside < worse(best.outside) for a in others):
        return None
    found = _registration(both, others)
    # only here: of a noisy side the lowest points lie below it, and a plate came out a sixth too thick
    return replace(found, t=resting(first, second, found.R, found.t))


def settled(first: Placed, second: Placed, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn (3, 3) and shift (3,) of the second placement, next to these, that the outlines bear best, with the surfaces laid onto
    each other where the outlines bear that as well.

    Outlines alone give way to silhouettes that take in shade: two plain rocks (Blender) came to lie 2.5 and 1.2 degrees, 4.0 and .9 px off, and
    1.5 and .5 degrees, 1.3 and .4 px with their surfaces.
    """
    both = _Pair(first, second, np.random.default_rng(52))
    by_rims = both.outlines.fitted(R, t, second.middle)
    by_points = both.laid(*by_rims)
    borne = both.outlines.score(*by_points) < worse(both.outlines.score(*by_rims))
    return by_points if borne else by_rims


def drawn_again(found: Registration, fits: Sequence[tuple[Placed, Placed, np.ndarray, np.ndarray]]) -> Registration:
    """A registration as silhouettes say it that were drawn again, of each answer from what it makes of the body.

    Args:
        found: by the silhouettes before.
        fits: of its answer, and of the next one where there is one, the placements with their silhouettes drawn again, R and t.
    """
    laid = []
    for first, second, R, t in fits:
        outlines = _outlines(first, second, np.random.default_rng(52))
        turn, shift = outlines.fitted(R, t, second.middle)
        laid.append(_Answer(turn, shift, outlines.score(turn, shift)))
    best, *others = laid
    both = _Pair(*fits[0][:2], np.random.default_rng(52))
    return replace(
        found,
        R=best.R,
        t=best.t,
        outside_px=best.outside,
        rival_px=min((a.outside for a in others), default=np.inf),
        own_px=0.5 * (both.first.rim_error + both.second.rim_error),
        covariance=both.covariance(best),
        candidates=((best.R, best.t),),
        turned=None,
    )


def next_answer(found: Registration) -> tuple[np.ndarray, np.ndarray] | None:
    """The best of the answers, R (3, 3) and t (3,), that turn the body otherwise; None where none was kept."""
    others = (a for a in found.candidates if vectors.turn_deg(a[0], found.R) > APART_DEG)
    return next(others, None)


def outlines_exclude(first: Placed, second: Placed, found: Registration, R: np.ndarray, t: np.ndarray) -> bool:
    """Whether what was found is clear, and R x + t is another answer that fits the outlines worse by more than these are wrong.

    Two sides of a part of one pattern agreed in 754 features (Blender), laid onto each other 5.9 px outside the outlines; the
    true turn is 0.6 px outside.
    """
    if not found.is_clearly_not(R):
        return False
    outlines = _outlines(first, second, np.random.default_rng(52))
    return bool(outlines.score(R, t) > worse(found.outside_px) + found.own_px)


def same_side(first: Placed, second: Placed, R: np.ndarray) -> bool:
    """Whether the body, the second placement turned by R (3, 3), lies on the same side in both; False where that is unknown."""
    if first.support is None or second.support is None:
        return False
    return bool(first.support[:3] @ R @ second.support[:3] > np.cos(np.deg2rad(APART_DEG)))


def resting(first: Placed, second: Placed, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The shift (3,) of the second placement, next to t, with which the lowest of each lies on what the other stood on.

    Outlines let two flat sides slide into each other. Only sides that were measured count.
    """
    rows, heights = [], []
    ways = ((first, second, R, t, np.eye(3)), (second, first, R.T, -R.T @ t, -R))
    for below, above, turn, shift, carried in ways:
        if below.support is None or not len(above.cloud):
            continue
        up = below.support[:3]
        if np.mean(above.cloud.normal @ turn.T @ up < -0.5) > DOWN:
            rows.append(carried @ up)
            heights.append(np.quantile((above.cloud.xyz @ turn.T + shift) @ up + below.support[3], LOWEST))
    # of two supports that are next to parallel only the mean height tells
    return t - np.linalg.lstsq(np.array(rows), np.array(heights), rcond=0.5)[0] if rows else t


def _candidates(best: _Answer, answers: list[_Answer]) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """The answer taken, and others that features may speak for."""
    by_colour = sorted(answers, key=lambda a: -a.colour)[:CANDIDATES]
    out: list[_Answer] = []
    for a in [best, *by_colour, *answers[:CANDIDATES]]:
        if all(a.away(b) > ALIKE_DEG for b in out):
            out.append(a)
    return tuple((a.R, a.t) for a in out)


def _chosen(answers: list[_Answer]) -> _Answer:
    """The answer that paint or silhouettes favour, of answers in the order of their silhouettes.

    The paint decides where it is clear: shapes may be incomplete, each on the side that was badly lit. How exactly the body lies
    the silhouettes tell better: of a photographed stamp the paint of a few points was most alike 9 degrees and 3 px off. Among
    answers that the silhouettes bear as well the paint decides at all.
    """
    near = [a for a in answers if a.outside < LARGEST_PAINTED]
    if near:
        best = max(near, key=lambda a: a.colour)
        others = [a for a in answers if a.away(best) > APART_DEG]
        rival = max((a.colour for a in others if a.outside < LARGEST_PAINTED), default=0.0)
        if best.colour > max(COLOUR, rival + AHEAD_SIGMAS * _noise(others)):
            return _most_alike([a for a in near if a.away(best) <= APART_DEG])
    return _most_alike(answers)


def _most_alike(answers: list[_Answer]) -> _Answer:
    """The answer of the most alike paint of those that the silhouettes bear as well as the first, which they bear best."""
    return max((a for a in answers if a.outside < worse(answers[0].outside)), key=lambda a: a.colour)


def _noise(wrong: list[_Answer]) -> float:
    """Standard deviation of the paint's correlation over wrong answers."""
    return max(LEAST_NOISE, float(np.std([a.colour for a in wrong])) if wrong else 0.0)


def _some(xyz: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return np.ascontiguousarray(xyz[np.sort(rng.permutation(len(xyz))[:most])])


def _outlines(first: Placed, second: Placed, rng: np.random.Generator) -> Pair:
    """What the outlines of either placement say of the other."""
    return Pair(first.extent, second.extent, _witnesses(first, rng), _witnesses(second, rng))


def _witnesses(side: Placed, rng: np.random.Generator) -> Witnesses:
    """A placement's rim rays, and some of its measured points."""
    xyz = _some(side.cloud.xyz, POINTS, rng)
    start = np.concatenate([side.rims.start, side.rims.start[-1] + 1 + np.arange(len(xyz))])
    return Witnesses(np.concatenate([side.rims.xyz, xyz]), start)


def texture(xyz: np.ndarray, colour: np.ndarray, at: np.ndarray, tree: cKDTree | None = None) -> np.ndarray:
    """(m, 3) logarithm of the colour over that of the surroundings: what is painted, not how it is lit.

    The lamp stays where it is when the object is turned, so that light and shade would join the wrong sides.

    Args:
        xyz, colour: (n, 3) points; at: (m, 3) where it is wanted; tree: of the points, where there is one.
    """
    from scipy.spatial import cKDTree

    near = (cKDTree(xyz) if tree is None else tree).query(at, k=min(COARSE, len(xyz)))[1]
    levels = [np.log(colour[near[:, :k]].mean(1, dtype=float) + 4.0) for k in (FINE, COARSE)]
    return np.asarray(levels[0] - levels[1])


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Mean over the channels of the correlation of two textures (n, 3)."""
    spread = one.std(0) * other.std(0)
    covariance = ((one - one.mean(0)) * (other - other.mean(0))).mean(0)
    return float(np.mean(covariance / np.maximum(spread, 1e-9)))


def overlap(first: Placed, second: Placed, R: np.ndarray, t: np.ndarray) -> float:
    """Share of the measured points of either placement that the other's photographs show, the second laid by R x + t; 0
    without photographs."""
    ways = ((first, second, R.T, -R.T @ t), (second, first, R, t))
    return float(min(_shown(a, b, Q, u)[1].mean() for a, b, Q, u in ways))


def _shown(side: Placed, other: Placed, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours (n, 3) that another placement's photographs show of a placement's points, carried by R x + t, and (n,) bool
    of which."""
    own, there = side.photographs, other.photographs
    if own is None or there is None:
        return np.zeros((len(side.cloud), 3)), np.zeros(len(side.cloud), bool)
    return there.paint(side.cloud, own.vertices, own.faces, R, t)


def _paint_shown(
    side: Placed, other: Placed, R: np.ndarray, t: np.ndarray, rng: np.random.Generator
) -> tuple[int, float]:
    """How many points of a placement, carried by R x + t, another's photographs show, and how their paint correlates."""
    colour, known = _shown(side, other, R, t)
    count = int(known.sum())
    if count < LEAST_SHOWN:
        return 0, 0.0
    xyz = side.cloud.xyz[known]
    at = _some(xyz, PAINTED, rng)
    return count, correlation(texture(xyz, side.colour[known], at), texture(xyz, colour[known], at))


class _Pair:
    """Two placements, ready to be laid onto each other."""

    def __init__(self, first: Placed, second: Placed, rng: np.random.Generator) -> None:
        from scipy.spatial import cKDTree

        self.first, self.second, self.rng = first, second, rng
        self.outlines = _outlines(first, second, rng)
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

    def answers(self) -> list[_Answer]:
        """Ways of laying the second placement onto the first, in the order of their silhouettes."""
        from scipy.spatial.transform import Rotation

        few = self.outlines.some(FEW, self.rng)
        middle = self.second.middle
        turns = Rotation.random(TRIED, rng=self.rng).as_matrix()
        shifts, scores = self.shifts(turns, few)
        order = np.argsort(scores, kind="stable")
        found = [few.fitted(turns[k], shifts[k], middle) for k in order[:FITTED]]
        kept: list[_Answer] = []
        for a in sorted((_Answer(R, t, few.score(R, t)) for R, t in found), key=lambda a: a.outside):
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

    def refined(self, answer: _Answer) -> _Answer:
        """The answer fitted to all silhouettes, and with its surfaces laid onto each other where those bear it."""
        ways = [self.outlines.fitted(answer.R, answer.t, self.second.middle)]
        ways.append(self.laid(*ways[0]))
        by_rims, by_points = (_Answer(R, t, self.outlines.score(R, t), self.colour(R, t)) for R, t in ways)
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

    def by_photographs(self, answer: _Answer) -> _Answer:
        """The answer with the paint's correlation between each placement's points and the other's photographs of them."""
        back = answer.R.T
        ways = ((self.first, self.second, back, -back @ answer.t), (self.second, self.first, answer.R, answer.t))
        found = [_paint_shown(a, b, R, t, self.rng) for a, b, R, t in ways]
        seen = sum(n for n, _ in found)
        return replace(answer, colour=sum(n * c for n, c in found) / seen if seen else 0.0)

    def covariance(self, answer: _Answer) -> np.ndarray:
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

    def one_body(self, one: _Answer, other: _Answer) -> bool:
        """Whether two ways of laying the second placement onto the first make the same body.

        They do where either placement looks the same to itself when it is turned from the one to the other. The side that a
        placement stood on belongs to it as its first shape closes it. It is asked with each kind of paint, which changes nothing
        of it, so that what was found is kept.
        """
        key = tuple(x.tobytes() for x in (one.R, one.t, other.R, other.t))
        if key not in self.same:
            self.same[key] = self._one_body(one, other)
        return self.same[key]

    def _one_body(self, one: _Answer, other: _Answer) -> bool:
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
