"""The best fit of one effect, or of one more beside others: over what is scanned, then moved to its best."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import ModuleType

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import (
    Term,
    follows_measured,
    lookalikes,
    scan,
    scan_again,
    steps,
    term_of,
    variants,
)
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import SETTLED, HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import Record
from massprops.diagnosis.screen import screened
from massprops.errors import NotPossible

SCANNED = 3
"""Values of what is scanned, the most likely after a few passes, that are fitted for each effect to the end."""
SHORTLISTED = 12
"""Values of what is scanned, the best in the screen, that are fitted for a few passes: near an event polynomials say
little of its time."""
BEGUN, FINISHED = 30, 12
"""Starts of an effect whose values move, the most likely after a pass, that are fitted for a few, and of these to the end."""
ENOUGH = 4
"""Starts, the most likely, that are fitted to the end where none comes near what is asked for."""
LONGER = 2.0
"""By how much an event may last longer than the one it began as: a chain of knocks over half a record is no contact."""
MOST_ALIKE = 0.98
"""Correlation of neighbouring residuals above which a record would count as no more than a few rows."""
STIFF = 3e-4
"""Prior 1-sigma of a gyroscope's scale and misalignment with which the fit of a measured wheel begins: with the usual one it went
from a ball to another minimum in 2 of 7 flights."""
BALL = Start(inertia=np.eye(3), left=1.0)
"""A start that knows nothing of the inertia."""


@dataclass(frozen=True, kw_only=True)
class FirstLook:
    """An effect from wherever its screen or its scan begins it.

    Attributes:
        effect: its file; begun: where it begins, values of what is scanned and an inertia; fits: what a few passes from there led to,
            none where nothing is scanned; more: other values worth a few passes.
    """

    effect: ModuleType
    begun: list[tuple[Term, Start]]
    fits: list[HypothesisFit] = field(default_factory=list)
    more: list[tuple[Term, Start]] = field(default_factory=list)

    @property
    def evidence(self) -> float:
        """Log evidence that the few passes came to; infinite where none were needed."""
        return max((f.verified for f in self.fits if can_be(f)), default=-np.inf) if self.fits else np.inf


def best_fit(record: Record, effect: ModuleType, base: HypothesisFit) -> HypothesisFit | None:
    """The best fit of one effect by itself, over what is scanned; None where its parameters have the wrong sign."""
    return followed(record, first_look(record, effect, base), base)


def first_look(record: Record, effect: ModuleType, base: HypothesisFit) -> FirstLook:
    """What a few passes say of an effect, at the values that the screen likes best or, where they move, at all."""
    gap = float(np.median(np.diff(record.times)))
    terms = scan(effect, record.times, record.path.w[record.rows.at])
    if any(t.moves for t in terms):
        fits = _from_all(record, terms, base)
        return FirstLook(effect=effect, begun=[(f.hypothesis.terms[0], again(f)) for f in fits], fits=fits)
    tried = [screened(record.screen or record, (t,), BALL) for t in terms]
    best = sorted((s for s in tried if s is not None), key=lambda s: -s.score)[:SHORTLISTED]
    begun = [(s.terms[0], start) for s in best for start in (s.start, BALL)]
    if len(best) < 2:
        return FirstLook(effect=effect, begun=begun)
    # where the screen's rates are polynomials through attitudes it says little of an event's moment, and a wrong length spoils the
    # right moment: all have their variants
    more = [(v, BALL) for s in best for v in variants(s.terms[0], gap)] if record.screen is not None else []
    return FirstLook(effect=effect, begun=begun, fits=_short_fits(record, begun), more=more)


def followed(record: Record, look: FirstLook, base: HypothesisFit, least: float = -np.inf) -> HypothesisFit | None:
    """The best fit of an effect to the end; None where its parameters have the wrong sign.

    Args:
        least: log evidence short of which it is not asked for more: values besides, starts besides, what is scanned moved to its best.
    """
    gap, begun = float(np.median(np.diff(record.times))), look.begun
    if any(t.moves for t, _ in begun):
        return _best_of(record, begun, gap, least)
    if look.fits:
        begun = _likeliest(look.fits + (_short_fits(record, look.more) if look.evidence > least else []))
        # along rates the screen says an event's moment, and the likeliest alone have their variants
        more = [(v, s) for t, start in begun for v in variants(t, gap) for s in (start, BALL)]
        begun = _likeliest(_short_fits(record, begun + more)) if more and record.screen is None else begun
    begun = begun + [(t, Start(inertia=base.inertia, left=1.0)) for t, _ in begun[:SCANNED]]
    if follows_measured(look.effect):
        begun = begun + [(t, s) for t, _ in begun[:1] for s in _stiff(record, t)]
    return _best_of(record, begun, gap, least)


def best_fit_again(record: Record, effect: ModuleType, base: HypothesisFit) -> HypothesisFit | None:
    """The best fit from other starts; None where the effect offers none, or they lead nowhere."""
    terms = scan_again(effect, record.times, record.path.w[record.rows.at])
    begun = [(f.hypothesis.terms[0], again(f)) for f in _from_all(record, terms, base)]
    return _best_of(record, begun, float(np.median(np.diff(record.times)))) if begun else None


def _best_of(
    record: Record, begun: list[tuple[Term, Start]], gap: float, least: float = -np.inf
) -> HypothesisFit | None:
    """The best fit from some starts, what is scanned moved to its best; see `followed`."""
    fits: list[HypothesisFit] = []
    for k, (term, start) in enumerate(begun):
        if k >= ENOUGH and all(f.verified < least for f in fits):
            break
        fit = admissible(record, Hypothesis(terms=(term,), latent=False), start, latent=False)
        fits += [] if fit is None else [fit]
    fits.sort(key=lambda f: -f.verified)
    if not fits or fits[0].verified < least:
        return fits[0] if fits else None
    # more than one: a scan stands at different moments of the same event; but one fit that two starts led to once
    apart = [f for k, f in enumerate(fits[:SCANNED]) if not any(_same(f, other) for other in fits[:k])]
    return _or_alike(max((moved_to_best(f, gap) for f in apart), key=lambda f: f.verified), gap)


def _from_all(record: Record, terms: list[Term], base: HypothesisFit) -> list[HypothesisFit]:
    """Of effects about values that move from where they begin, those that a few passes leave the most likely, of those that are so
    after one: each begins at a ball or at the free body's inertia, in turn."""
    inertias = (BALL, Start(inertia=base.inertia, left=1.0))
    begun, fits = [(t, inertias[k % 2]) for k, t in enumerate(terms)], []
    for passes, kept in ((1, BEGUN), (3, FINISHED)):
        fits = sorted(_short_fits(record, begun, passes), key=lambda f: (not can_be(f), -f.verified))[:kept]
        begun = [(f.hypothesis.terms[0], again(f)) for f in fits]
    return fits


def _same(a: HypothesisFit, b: HypothesisFit) -> bool:
    """Whether two fits of one hypothesis have come to the same solution."""
    return a.hypothesis == b.hypothesis and abs(a.evidence - b.evidence) < SETTLED


def _stiff(record: Record, term: Term) -> list[Start]:
    """Where the effect leads with a gyroscope that has hardly any errors."""
    with suppress(NotPossible):
        return [again(fit_hypothesis(record, Hypothesis(terms=(term,), latent=False, scale=STIFF), BALL))]
    return []


def _or_alike(found: HypothesisFit, gap: float) -> HypothesisFit:
    """The likeliest of a fit of one effect and of fits of the effect at values that look nearly the same, begun there: a push in parts
    finds a contact's bounds, within which one even push may do; a mass on a spring looks much as one whose arm and way are exchanged."""
    best = found
    for other in lookalikes(found.hypothesis.terms[0]):
        fit = admissible(found.record, replace(found.hypothesis, terms=(other,)), again(found), latent=False)
        if fit is not None:
            fit = moved_to_best(fit, gap)
            best = fit if fit.verified > best.verified else best
    return best


def _likeliest(fits: list[HypothesisFit]) -> list[tuple[Term, Start]]:
    """The values with which short fits are the most likely, with where these came to."""
    ranked = sorted(fits, key=lambda f: -f.evidence)
    different = {f.hypothesis.terms[0]: f for f in reversed(ranked)}
    ranked = sorted(different.values(), key=lambda f: -f.evidence)[:SCANNED]
    return [(f.hypothesis.terms[0], again(f)) for f in ranked]


def _short_fits(record: Record, begun: list[tuple[Term, Start]], passes: int = 3) -> list[HypothesisFit]:
    fits = []
    for term, start in begun:
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, Hypothesis(terms=(term,), latent=False), start, passes=passes))
    return fits


def moved_to_best(found: HypothesisFit, gap: float, which: int = 0) -> HypothesisFit:
    """What was scanned of a fit's effect moved to its best by Nelder and Mead's method.

    Args:
        gap: between measurements [s]; which: of the effects in the hypothesis.
    """
    from scipy.optimize import minimize

    terms = found.hypothesis.terms
    term = terms[which]
    size = steps(term, gap)
    if not size:
        return found
    names, held = list(size), dict(term.held)
    kind = {q.name: q.kind for q in term.effect.PARAMETERS}
    best = found

    def cost(x: np.ndarray) -> float:
        nonlocal best
        values = held | {n: held[n] + v * size[n] for n, v in zip(names, x, strict=True)}
        if any(values[n] < 0.0 for n in names if kind[n] != "direction"):
            return 1e12
        if values.get("duration", 0.0) > max(LONGER * held.get("duration", 0.0), gap):
            return 1e12
        moved = (*terms[:which], term_of(term.effect, values), *terms[which + 1 :])
        try:
            fit = fit_hypothesis(found.record, replace(found.hypothesis, terms=moved), again(found), passes=3)
        except NotPossible:
            return 1e12
        if not can_be(fit):
            return 1e12
        best = fit if fit.evidence > best.evidence else best
        return -fit.evidence

    minimize(cost, np.zeros(len(names)), method="Nelder-Mead",
             options={"maxfev": 25 * len(names), "xatol": 0.02, "fatol": 0.1,
                      "initial_simplex": np.concatenate([np.zeros((1, len(names))), np.eye(len(names))])})  # fmt: skip
    last = admissible(best.record, best.hypothesis, again(best), best.hypothesis.latent) or best
    return last if last.verified > found.verified - SETTLED else found


def again(fit: HypothesisFit) -> Start:
    """Where another fit from a fit's solution begins."""
    return Start(inertia=fit.inertia, left=1.0, axis=fit.axis, history=fit.history)


def admissible(record: Record, hypothesis: Hypothesis, start: Start, latent: bool) -> HypothesisFit | None:
    """The fit of a hypothesis, or None where it leads nowhere or to what cannot be."""
    h = replace(hypothesis, latent=latent)
    try:
        fit = fit_hypothesis(record, h, start)
    except NotPossible:
        return None
    return fit if can_be(fit) else None


def can_be(fit: HypothesisFit) -> bool:
    """Whether no parameter is below its least beyond doubt, and an inertia after a change is a body's."""
    wide = criteria.SHOWN * widening(fit.residual)
    for term in fit.hypothesis.terms:
        least = {q.name: q.least for q in term.effect.PARAMETERS}
        sd = np.sqrt(np.maximum(np.diag(fit.covariance[term.name]), 0.0))
        for name, value, s in zip(term.unknowns, fit.values[term.name], sd, strict=True):
            lowest = least[name]
            if lowest is not None and value + wide * s < lowest:
                return False
        possible = getattr(term.effect, "can_be", None)
        if possible is not None and not possible(fit.inertia, fit.rate, fit.values[term.name]):
            return False
        if hasattr(term.effect, "inertia") and not _is_a_body(fit, term):
            return False
    return True


def widening(residual: np.ndarray) -> float:
    """By how much sigmas grow when neighbouring residuals (m, k) are alike, as those of a first-order autoregression are:
    where something else acts too, so many rows say less than as many independent ones."""
    alike = float(np.sum(residual[1:] * residual[:-1]) / max(float(np.sum(residual**2)), 1e-300))
    alike = min(max(alike, 0.0), MOST_ALIKE)
    return float(np.sqrt((1.0 + alike) / (1.0 - alike)))


def _is_a_body(fit: HypothesisFit, term: Term) -> bool:
    """Whether the inertia with an effect's change of it is one that a body can have: second moments of mass that are not
    nothing, and about as large as before. A change that takes the whole inertia away leaves any rates unopposed."""
    a, b, c, d, e, f = fit.values[term.name][:6]
    after = fit.inertia + np.array([[a, d, e], [d, b, f], [e, f, c]])
    second = np.linalg.eigvalsh(0.5 * np.trace(after) * np.eye(3) - after)
    before = np.linalg.eigvalsh(0.5 * np.trace(fit.inertia) * np.eye(3) - fit.inertia)
    least = criteria.LEAST_SHARE * np.trace(fit.inertia)
    grown = np.trace(after) / np.trace(fit.inertia)
    return bool(min(second[0], before[0]) > least and 1.0 / criteria.MOST_GROWN < grown < criteria.MOST_GROWN)
