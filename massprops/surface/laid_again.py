"""What was found of two placements, asked again: of surfaces, of other silhouettes, or of another answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprops.geometry import vectors
from massprops.surface.answers import APART_DEG, Answer, PlacementPair, outlines_of, worse
from massprops.surface.placed import Placed
from massprops.surface.registration import Registration


def settled(first: Placed, second: Placed, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn (3, 3) and shift (3,) of the second placement, next to these, that the outlines bear best, with the surfaces laid onto
    each other where the outlines bear that as well.

    Outlines alone give way to silhouettes that take in shade: two plain rocks (Blender) came to lie 2.5 and 1.2 degrees, 4.0 and .9 px off, and
    1.5 and .5 degrees, 1.3 and .4 px with their surfaces.
    """
    both = PlacementPair(first, second, np.random.default_rng(52))
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
        outlines = outlines_of(first, second, np.random.default_rng(52))
        turn, shift = outlines.fitted(R, t, second.middle)
        laid.append(Answer(turn, shift, outlines.score(turn, shift)))
    best, *others = laid
    both = PlacementPair(*fits[0][:2], np.random.default_rng(52))
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
    outlines = outlines_of(first, second, np.random.default_rng(52))
    return bool(outlines.score(R, t) > worse(found.outside_px) + found.own_px)
