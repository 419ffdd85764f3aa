"""Two placements of one rigid body laid onto each other by its silhouettes, its shape and its paint, without features.

Small glossy things have too few features in common. But the silhouettes of both must be those of one body (`coherence`), where
both saw the same side their surfaces must lie on each other (`answers`) and have the same paint (`paint`), and where they
measured next to nothing in common, the photographs of each must show the other's. The best answer must be clearly better than
every other turn, but for those that make the same body.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.geometry import vectors
from massprops.surface.answers import ALIKE_DEG, APART_DEG, Answer, PlacementPair, worse
from massprops.surface.placed import Placed
from massprops.surface.stood_on import resting, same_side

CANDIDATES = 4
"""Answers that silhouettes, and as many that paint favours, for which features are looked for."""
COLOUR, AHEAD_SIGMAS = 0.1, 2.0
"""Least correlation of the paint that decides, and by how many standard deviations of wrong answers it must exceed any
other answer's."""
LEAST_NOISE = 0.03
"""Smallest standard deviation of wrong answers' paint: of `PAINTED` points at most half lie where both were seen."""
LARGEST = 1.5
"""Mean distance outside [px] above which nothing fits."""
LARGEST_PAINTED = 4.0
"""The same where the paint decides: shapes lack sides that were badly lit."""


@dataclass(frozen=True)
class Registration:
    """How one placement lies in the frame of another.

    Attributes:
        R, t: (3, 3) and (3,): x in the first placement's frame is R x + t of the second's.
        outside_px: mean distance by which rims and points of each miss the silhouettes of the other.
        rival_px: the same of the best rotation that is another answer, and makes another body.
        colour: correlation of the colours where both placements measured the surface, or where that does not decide, of
            each placement's points with what the other's photographs show there.
        rival_colour: the largest of the other answers that the silhouettes do not tell from this one. Of a photographed stamp an answer 3.6 px
            outside had .299, as much as the right one 1.0 px outside, so that one seed in three did not join it.
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


def register(first: Placed, second: Placed, seed: int = 0) -> Registration:
    """The rotation and shift that carry the second placement onto the first.

    Args:
        first, second: placements in the units of one reconstruction.
        seed: of the rotations and points tried.
    """
    both = PlacementPair(first, second, np.random.default_rng([seed, 31]))
    answers = both.answers()
    registration = _registration(both, answers)
    if registration.painted or first.photographs is None or second.photographs is None:
        return registration
    # what both measured does not tell: what the photographs of each show of the other's points may
    shown = _registration(both, [both.by_photographs(a) if a.outside < LARGEST_PAINTED else a for a in answers])
    return shown if shown.painted else registration


def _registration(both: PlacementPair, answers: list[Answer]) -> Registration:
    """The answer that silhouettes and paint favour, and what speaks against the others."""
    first, second = both.first, both.second
    best = _chosen(answers)
    others = [a for a in answers if a.away(best) > APART_DEG]
    noise = _noise(others)
    same = _same_body(both, best, answers)
    alike = [a for a in others if a in same]
    rivals = [a.outside for a in others if a not in alike]
    own_px = 0.5 * (first.rim_error + second.rim_error)

    def behind(a: Answer) -> bool:
        """Whether the silhouettes tell an answer from the best, and the paint does not speak for it."""
        by_shape = best.outside < LARGEST and a.outside > worse(best.outside) + own_px
        return a.outside >= LARGEST_PAINTED or (by_shape and a.colour - best.colour < AHEAD_SIGMAS * noise)

    return Registration(
        R=best.R,
        t=best.t,
        outside_px=best.outside,
        rival_px=min(rivals, default=np.inf),
        colour=best.colour,
        rival_colour=max((a.colour for a in others if not behind(a)), default=min(best.colour, 0.0)),
        colour_noise=noise,
        covariance=both.covariance(best),
        symmetric=any(a.outside < worse(best.outside) for a in alike),
        own_px=own_px,
        candidates=_candidates(best, answers),
        turned=_turned(both, best, answers),
        turned_px=min((a.outside for a in answers if not same_side(first, second, a.R)), default=np.inf),
    )


def _same_body(both: PlacementPair, best: Answer, answers: list[Answer]) -> list[Answer]:
    """The answers that make the same body as the best, or as one of these that fits as well.

    A body of revolution can be turned by any angle. By a small one it is seen to stay the same; by a large one two parts of it lie
    on each other that were measured in one placement each.
    """
    same_bodies, todo = [], [best]
    remaining_answers = [a for a in answers if a is not best]
    while todo:
        one = todo.pop()
        more = [a for a in remaining_answers if both.one_body(one, a)]
        remaining_answers = [a for a in remaining_answers if a not in more]
        todo += [a for a in more if a.outside < worse(best.outside)]
        same_bodies += more
    return same_bodies


def _turned(both: PlacementPair, best: Answer, answers: list[Answer]) -> Registration | None:
    """The registration by the answers that lay the body on another side, where that taken does not and is no better."""
    first, second = both.first, both.second
    if not same_side(first, second, best.R):
        return None
    others = [a for a in answers if not same_side(first, second, a.R)]
    if not any(a.outside < worse(best.outside) for a in others):
        return None
    registration = _registration(both, others)
    # only here: of a noisy side the lowest points lie below it, and a plate came out a sixth too thick
    return replace(registration, t=resting(first, second, registration.R, registration.t))


def _candidates(best: Answer, answers: list[Answer]) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """The answer taken, and others that features may speak for."""
    by_colour = sorted(answers, key=lambda a: -a.colour)[:CANDIDATES]
    out: list[Answer] = []
    for a in [best, *by_colour, *answers[:CANDIDATES]]:
        if all(a.away(b) > ALIKE_DEG for b in out):
            out.append(a)
    return tuple((a.R, a.t) for a in out)


def _chosen(answers: list[Answer]) -> Answer:
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


def _most_alike(answers: list[Answer]) -> Answer:
    """The answer of the most alike paint of those that the silhouettes bear as well as the first, which they bear best."""
    return max((a for a in answers if a.outside < worse(answers[0].outside)), key=lambda a: a.colour)


def _noise(wrong: list[Answer]) -> float:
    """Standard deviation of the paint's correlation over wrong answers."""
    return max(LEAST_NOISE, float(np.std([a.colour for a in wrong])) if wrong else 0.0)
