"""Two effects at once: every pair of the catalogue solved for together, and every effect beside a wheel of any history.

Nothing is looked for beside a single effect that the other one bends. Each pair begins along the motion that a free body
with an unknown torque follows, which is right to the noise whatever acts.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import combinations
from types import ModuleType

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.conserved_start import Start, conserved_across, left_across, with_mean_moment_about_axis
from massprops.diagnosis.effect_columns import has_known_rate, in_balance, steps, term_of, variants
from massprops.diagnosis.effect_search import BALL, admissible, again, can_be, moved_to_best
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.pair_scan import KEPT, Scanned, Terms, least_left, scanned
from massprops.diagnosis.record import Record
from massprops.errors import NotPossible

FIRSTS = 2
"""Single effects, the most likely, whose inertias a pair begins at as well."""
SCREENED = 40
"""Pairs, those that leave the least momentum at their best values, that are fitted at all. Of 13 drawn pairs what acted was among
the first 22 of 66 in 12; a wheel with a firing was the 31st (`tests/diagnosis/pair_worlds.py`)."""
SHORT = 3
"""Passes of the fits that pairs are chosen by."""
FINISHED = 8
"""Pairs, the most likely after `SHORT` passes, that are fitted to the end."""
SCANNED = 3
"""Values of one pair, the most likely after two passes, that are fitted to the end."""
NEIGHBOURS = (-2.0, -1.0, 1.0, 2.0)
"""Steps (`momentum_steps`) to either side of a scanned value that are tried where an effect has no variants."""
MOVED = 3
"""Pairs, the most likely, whose times and time constants are moved to their best."""
WHEELS = 3
"""Effects, the most likely beside a wheel of any history, that are fitted beside the wheel to the end: so many of those with an
unknown torque besides, and of those without."""
LAG = 0.045
"""Time constant of that wheel over the record: the middle of `selection.LAGS`."""


def pairs(
    record: Record,
    unknown: HypothesisFit,
    singles: list[HypothesisFit],
    usable: list[ModuleType],
    free: float = -np.inf,
    is_enough: Callable[[HypothesisFit], bool] = lambda fit: False,
) -> list[HypothesisFit]:
    """Fits of two effects, the most likely first.

    Args:
        unknown: the free body with an unknown torque; singles: effects by themselves, the most likely first; usable: what
            may act. free: log evidence of the free body: a pair that gains over it less than `criteria.FOLLOWED` of what the likeliest
            does is not followed. is_enough: whether a pair leaves nothing to a wheel of any history beside an effect.
    """
    gap = float(np.median(np.diff(record.times)))
    along = record if record.rows.rates else unknown.record
    starts = [Start(inertia=unknown.inertia, left=1.0), BALL, *(again(f) for f in singles[:FIRSTS])]
    alone = {f.names[0]: f.hypothesis.terms[0] for f in singles if f.hypothesis.terms}
    # an effect that is not linear in its unknowns bends to what sunlight on faces leaves: the two passed for a periodic torque
    linear = [m for m in usable if not hasattr(m, "momentum_moved")]
    forced = [scanned(along, effect, unknown, alone.get(effect.NAME)) for effect in linear]
    firsts = {candidate.name: candidate for candidate in forced}
    seconds = [m for m in in_balance() if getattr(m, "BESIDE", None) in firsts]
    both = [*combinations(forced, 2), *((firsts[m.BESIDE], scanned(along, m, unknown, None)) for m in seconds)]
    tried = sorted((least_left(along, a, b) for a, b in both), key=lambda t: t[0][1].left)
    begun: list[list[HypothesisFit]] = []
    for candidate in tried[:SCREENED]:
        fits = _begun(along, candidate, gap, _least(begun, free))
        begun += [fits] if fits and can_be(fits[0]) else []
    begun.sort(key=lambda f: -f[0].evidence)
    least = _least(begun, free)
    finished = [_finished(along, fits, starts if fits[0].evidence > least else []) for fits in begun[:FINISHED]]
    ranked = sorted((f for f in finished if f is not None), key=lambda f: -f.evidence)
    moved = [_all_moved(f, gap) if f.evidence > least else f for f in ranked[:MOVED]]
    wheels = [] if any(map(is_enough, moved)) else _beside_wheel(along, forced, gap)
    return sorted([*moved, *ranked[MOVED:], *wheels], key=lambda f: -f.evidence)


def _least(begun: list[list[HypothesisFit]], free: float) -> float:
    """Log evidence short of which a pair is not followed to its end."""
    return criteria.followed_from(free, max((f[0].evidence for f in begun), default=-np.inf))


def _begun(record: Record, tried: list[tuple[Terms, Start]], gap: float, least: float) -> list[HypothesisFit]:
    """The likeliest values of what is scanned of two effects, and of their variants, after a few passes.

    Args:
        tried: values, those that leave the least momentum first, and the inertias that these leave it with; least: see `_least`.
    """
    # few values begin at a ball as well
    fits = _ranked(
        [f for terms, start in tried for f in _short(record, [terms], [start, BALL][: 1 + (len(tried) <= KEPT)])]
    )
    if not fits or len(tried) == 1 or fits[0].evidence < least:
        return fits
    more = [v for f in fits[:2] for v in _varied(f.hypothesis.terms, gap)]
    return _ranked([*fits, *_short(record, more, [again(fits[0])])])


def _ranked(fits: list[HypothesisFit]) -> list[HypothesisFit]:
    """What can be first, the likeliest first, the best `SCANNED`."""
    return sorted(fits, key=lambda f: (not can_be(f), -f.evidence))[:SCANNED]


def _short(record: Record, tried: list[Terms], starts: list[Start], wheel: float = 0.0) -> list[HypothesisFit]:
    """Fits of a few passes, the most likely first, the best `SCANNED` values.

    Args:
        wheel: time constant of a wheel of any history beside them [s], or 0.
    """
    fits = []
    for terms in tried:
        hypothesis = Hypothesis(terms=terms, wheel=wheel > 0, lag=wheel, latent=False)
        fits_of_terms = []
        for start in starts:
            with suppress(NotPossible):
                fits_of_terms.append(fit_hypothesis(record, hypothesis, start, passes=SHORT))
        fits += [max(fits_of_terms, key=lambda f: f.evidence)] if fits_of_terms else []
    return _ranked(fits)


def _varied(terms: Terms, gap: float) -> list[Terms]:
    """Other values of what is scanned that are worth a fit: an effect's variants, or a few steps to either side."""
    out = []
    for k, term in enumerate(terms):
        held, size = dict(term.held), steps(term, gap)
        near = variants(term, gap)
        if not near:
            near = [term_of(term.effect, held | {n: held[n] + m * v}) for n, v in size.items() for m in NEIGHBOURS]
        out += [(*terms[:k], v, *terms[k + 1 :]) for v in near]
    return out


def _finished(record: Record, fits: list[HypothesisFit], starts: list[Start]) -> HypothesisFit | None:
    """The best fit of two effects to the end; None where they have the wrong sign."""
    done = []
    for fit in fits:
        hypothesis = fit.hypothesis
        done += [admissible(record, hypothesis, s, latent=False) for s in (again(fit), *starts)]
    return max((f for f in done if f is not None), key=lambda f: f.evidence, default=None)


def _beside_wheel(record: Record, forced: list[Scanned], gap: float) -> list[HypothesisFit]:
    """Fits of an effect and a wheel of any history, about the axis across which both conserve momentum best."""
    if any(has_known_rate(scanned_effect.terms[0].effect) for scanned_effect in forced):
        return []
    path, at, lag = record.path, record.rows.at, LAG * record.path.span
    begun: dict[bool, list[HypothesisFit]] = {True: [], False: []}
    for scanned_effect in forced:
        if scanned_effect.name == "internal-rotor":
            continue
        remaining_momentum = (
            [left_across(path, at, f) for f in scanned_effect.forcings] if len(scanned_effect.terms) > 1 else [0.0]
        )
        for k in np.argsort(remaining_momentum)[:2]:
            start = conserved_across(path, at, scanned_effect.forcings[k])
            # beside an unknown torque, which keeps the wheel from answering for what the scanned value misses; and without, as
            # it may answer for the inertia
            for latent, where in ((True, start), (False, with_mean_moment_about_axis(start, path))):
                h = Hypothesis(terms=(scanned_effect.terms[k],), wheel=True, lag=lag, latent=latent)
                with suppress(NotPossible):
                    begun[latent].append(fit_hypothesis(record, h, where, passes=SHORT))
    firsts = sorted(begun[True], key=lambda f: -f.evidence)[:WHEELS]
    firsts += sorted((f for f in begun[False] if can_be(f)), key=lambda f: -f.evidence)[:WHEELS]
    admitted = []
    for first in firsts:
        terms = first.hypothesis.terms
        short = _short(record, [terms, *_varied(terms, gap)], [again(first)], lag)
        fits = [admissible(record, f.hypothesis, again(f), latent=False) for f in short[:1]]
        admitted += [f for f in fits if f is not None]
    # either start may lead to the same effects
    likeliest = {f.names: f for f in sorted(admitted, key=lambda f: f.evidence)}
    ranked_wheels = sorted(likeliest.values(), key=lambda f: -f.evidence)
    return [_all_moved(f, gap) for f in ranked_wheels[:1]] + ranked_wheels[1:]


def _all_moved(fit: HypothesisFit, gap: float) -> HypothesisFit:
    for which in range(len(fit.hypothesis.terms)):
        fit = moved_to_best(fit, gap, which)
    return fit
