"""Which effect a record's rigid body lacks: every one in the catalogue by the balance of momentum, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import ModuleType

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.conserved_start import Start, conserved, conserved_across
from massprops.diagnosis.effect_columns import Term, in_balance, scan, steps, term_of, variants
from massprops.diagnosis.hypothesis_fit import Hypothesis, HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import Record
from massprops.diagnosis.screen import screened
from massprops.errors import NotPossible

Watch = Callable[[str, int, int], None]
SCANNED = 3
"""Values of what is scanned, the most likely after a few passes, that are fitted for each effect to the end."""
SHORTLISTED = 12
"""Values of what is scanned, the best in the screen, that are fitted for a few passes: near an event polynomials say
little of its time."""
LAGS = (0.02, 0.03, 0.045, 0.065, 0.1)
"""Time constants of a wheel tried, over the record's length: from what the knots of its drive can draw. On the odd flights,
whose wheel has one of about .07, evidence chose .03 to .045 and its size came within 7 % in 7 of 7; without a lag within
10 % in 5."""
LONGER = 2.0
"""By how much an event may last longer than the one it began as: a chain of knocks over half a record is no contact."""
BALL = Start(inertia=np.eye(3), left=1.0)
BESIDE_UNKNOWN = 4
"""Effects, the best by themselves, that are fitted beside a latent torque as well."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that was tried.

    Attributes:
        alone: fitted by itself; beside: beside a latent torque, or None where it was not worth it.
    """

    alone: HypothesisFit
    beside: HypothesisFit | None = None

    @property
    def name(self) -> str:
        return " + ".join(self.alone.names)

    @property
    def evidence(self) -> float:
        """Log evidence of the better of the two."""
        return max(self.alone.evidence, -np.inf if self.beside is None else self.beside.evidence)

    @property
    def best(self) -> HypothesisFit:
        """The better of the two."""
        if self.beside is not None and self.beside.evidence > self.alone.evidence:
            return self.beside
        return self.alone


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What was found.

    Attributes:
        base: the plain rigid body; unknown: with a latent torque; tried: effects, the most likely first.
        verdict: `none`, `named`, `ambiguous` or `unexplained`; named: the effects of the verdict; skipped: why others
            were not tried, by name.
    """

    base: HypothesisFit
    unknown: HypothesisFit
    tried: tuple[Candidate, ...]
    verdict: str
    named: tuple[Candidate, ...]
    skipped: dict[str, str] = field(default_factory=dict)


def select(record: Record, watch: Watch = lambda what, done, total: None) -> Selection:
    """The effect that a record's rigid body lacks."""
    watch("rigid body", 0, 1)
    base, unknown = without_effects(record)
    if unknown is base:
        return Selection(base=base, unknown=base, tried=(), verdict="none", named=())
    usable, skipped = usable_effects(record)
    tried = []
    for k, effect in enumerate(usable):
        watch(f"balance of momentum: {effect.NAME}", k, len(usable))
        found = _alone(record, effect, base)
        if found is not None:
            tried.append(Candidate(alone=found))
    watch("balance of momentum: internal-rotor of any history", 0, 1)
    with suppress(NotPossible):
        tried.append(_wheel(record))
    tried.sort(key=lambda c: -c.alone.evidence)
    for k, one in enumerate(tried[:BESIDE_UNKNOWN]):
        if one.beside is not None:
            continue
        watch(f"beside an unknown torque: {one.name}", k, BESIDE_UNKNOWN)
        h = one.alone.hypothesis
        tried[k] = Candidate(alone=one.alone, beside=_admissible(record, h, _again(one.alone), latent=True))
    tried.sort(key=lambda c: -c.evidence)
    verdict, named = _verdict(base, unknown, tried)
    return Selection(
        base=base, unknown=unknown, tried=tuple(tried), verdict=verdict, named=tuple(named), skipped=skipped
    )


def without_effects(record: Record) -> tuple[HypothesisFit, HypothesisFit]:
    """The plain rigid body, and with a latent torque; the same twice where nothing is left that the stated noise does not
    explain."""
    plain = conserved(record.path, record.rows.at)
    base = _best(record, Hypothesis(latent=False), [plain, Start(inertia=np.eye(3), left=1.0)])
    if record.stated and within_noise(base):
        return base, base
    return base, _best(record, Hypothesis(), [plain, Start(inertia=base.inertia, left=1.0)])


def rigid_body_alone(record: Record) -> Selection:
    """Nothing but the plain rigid body, where no effect could be told."""
    base = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    return Selection(base=base, unknown=base, tried=(), verdict="none", named=())


def _best(record: Record, hypothesis: Hypothesis, starts: list[Start]) -> HypothesisFit:
    fits = []
    for start in starts:
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, hypothesis, start))
    return max(fits, key=lambda f: f.evidence) if fits else fit_hypothesis(record, hypothesis, BALL)


def usable_effects(record: Record) -> tuple[list[ModuleType], dict[str, str]]:
    """The effects that the balance can hold with what is known about the record, and why others are left out."""
    known = set() if record.around is None else set(record.around.known)
    usable, skipped = [], {}
    for effect in in_balance():
        missing = [n for n in effect.NEEDS if n not in known]
        if missing:
            skipped[effect.NAME] = f"needs {', '.join(missing)}"
        else:
            usable.append(effect)
    return usable, skipped


def _alone(record: Record, effect: ModuleType, base: HypothesisFit) -> HypothesisFit | None:
    """The best fit of one effect by itself, over what is scanned; None where its parameters have the wrong sign."""
    view, gap = record.screen or record, float(np.median(np.diff(record.times)))
    tried = [screened(view, (t,), BALL) for t in scan(effect, record.times, record.path.w[record.rows.at])]
    best = sorted((s for s in tried if s is not None), key=lambda s: -s.score)[:SHORTLISTED]
    begun = [(s.terms[0], start) for s in best for start in (s.start, BALL)]
    if len(best) > 1:
        # variants of all of them at once: a knock's length decides how well each moment does
        begun = _by_short_fits(record, begun + [(v, BALL) for s in best for v in variants(s.terms[0], gap)])
    begun += [(t, Start(inertia=base.inertia, left=1.0)) for t, _ in begun[:SCANNED]]
    found = [_admissible(record, Hypothesis(terms=(t,), latent=False), s, latent=False) for t, s in begun]
    fits = sorted((f for f in found if f is not None), key=lambda f: -f.evidence)
    # more than one: a scan stands at different moments of the same event
    return max((moved_to_best(record, f, gap) for f in fits[:SCANNED]), key=lambda f: f.evidence, default=None)


def _by_short_fits(record: Record, begun: list[tuple[Term, Start]]) -> list[tuple[Term, Start]]:
    """Those that a few passes on the measurements themselves leave the most likely, with where they came to."""
    fits = []
    for term, start in begun:
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, Hypothesis(terms=(term,), latent=False), start, passes=3))
    fits = sorted(fits, key=lambda f: -f.evidence)
    different = {f.hypothesis.terms[0]: f for f in reversed(fits)}
    fits = sorted(different.values(), key=lambda f: -f.evidence)[:SCANNED]
    return [(f.hypothesis.terms[0], _again(f)) for f in fits]


def moved_to_best(record: Record, found: HypothesisFit, gap: float) -> HypothesisFit:
    """What was scanned of a fit's effect moved to its best by Nelder and Mead's method.

    Args:
        gap: between measurements [s].
    """
    from scipy.optimize import minimize

    term = found.hypothesis.terms[0]
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
        h = Hypothesis(terms=(term_of(term.effect, values),), latent=found.hypothesis.latent)
        try:
            fit = fit_hypothesis(found.record, h, _again(found), passes=3)
        except NotPossible:
            return 1e12
        if not can_be(fit):
            return 1e12
        best = fit if fit.evidence > best.evidence else best
        return -fit.evidence

    minimize(cost, np.zeros(len(names)), method="Nelder-Mead",
             options={"maxfev": 25 * len(names), "xatol": 0.02, "fatol": 0.1,
                      "initial_simplex": np.concatenate([np.zeros((1, len(names))), np.eye(len(names))])})  # fmt: skip
    return _admissible(best.record, best.hypothesis, _again(best), best.hypothesis.latent) or best


def _again(fit: HypothesisFit) -> Start:
    """Where another fit from a fit's solution begins."""
    return Start(inertia=fit.inertia, left=1.0, axis=fit.axis, history=fit.history)


def _admissible(record: Record, hypothesis: Hypothesis, start: Start, latent: bool) -> HypothesisFit | None:
    """The fit of a hypothesis, or None where it leads nowhere or to what cannot be."""
    h = replace(hypothesis, latent=latent)
    try:
        found = fit_hypothesis(record, h, start)
    except NotPossible:
        return None
    return found if can_be(found) else None


def can_be(found: HypothesisFit) -> bool:
    """Whether no parameter is below its least beyond doubt, and an inertia after a change is a body's."""
    for term in found.hypothesis.terms:
        least = {q.name: q.least for q in term.effect.PARAMETERS}
        sd = np.sqrt(np.maximum(np.diag(found.covariance[term.name]), 0.0))
        for name, value, s in zip(term.unknowns, found.values[term.name], sd, strict=True):
            lowest = least[name]
            if lowest is not None and value + criteria.SHOWN * s < lowest:
                return False
        if hasattr(term.effect, "inertia") and not _is_a_body(found, term):
            return False
    return True


def _is_a_body(found: HypothesisFit, term: Term) -> bool:
    """Whether the inertia with an effect's change of it is one that a body can have: second moments of mass that are not
    nothing, and about as large as before. A change that takes the whole inertia away leaves any rates unopposed."""
    a, b, c, d, e, f = found.values[term.name][:6]
    after = found.inertia + np.array([[a, d, e], [d, b, f], [e, f, c]])
    second = np.linalg.eigvalsh(0.5 * np.trace(after) * np.eye(3) - after)
    before = np.linalg.eigvalsh(0.5 * np.trace(found.inertia) * np.eye(3) - found.inertia)
    least = criteria.LEAST_SHARE * np.trace(found.inertia)
    grown = np.trace(after) / np.trace(found.inertia)
    return bool(min(second[0], before[0]) > least and 1.0 / criteria.MOST_GROWN < grown < criteria.MOST_GROWN)


def _wheel(record: Record) -> Candidate:
    """A wheel of any history along one axis: with a latent torque first, which keeps it from answering for all.

    Raises:
        NotPossible: no axis leads anywhere.
    """
    first = fit_hypothesis(record, Hypothesis(wheel=True), conserved_across(record.path, record.rows.at))
    lags = record.path.span * np.array(LAGS)
    fits = []
    for lag in lags:
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, Hypothesis(wheel=True, lag=float(lag)), _again(first)))
    # how the wheel follows its drive has no say in its axis: a fit that left it went astray
    fits = [f for f in fits if _apart(f, first) < criteria.AXIS_SD]
    beside = max(fits, key=lambda f: f.evidence, default=first)
    alone = fit_hypothesis(record, replace(beside.hypothesis, latent=False), _again(beside))
    return Candidate(alone=alone, beside=beside)


def _apart(a: HypothesisFit, b: HypothesisFit) -> float:
    """Angle between the axes of two wheels [rad]."""
    assert a.axis is not None and b.axis is not None
    return float(np.arccos(min(1.0, abs(float(a.axis @ b.axis)))))


def _verdict(base: HypothesisFit, unknown: HypothesisFit, tried: list[Candidate]) -> tuple[str, list[Candidate]]:
    something = max([unknown.evidence, *(c.evidence for c in tried)])
    if something < base.evidence + criteria.BEATS_NOTHING + np.log(1 + len(tried)):
        return "none", []
    good = [c for c in tried if may_be_named(c, base, unknown)]
    if not good:
        return "unexplained", []
    near = [c for c in good if c.evidence > good[0].evidence - criteria.ALIKE]
    # what an unknown torque beside them hides: how much each explains by itself
    alone = max(near, key=lambda c: c.alone.evidence)
    near = [alone, *(c for c in near if c is not alone and c.alone.evidence > alone.alone.evidence - criteria.ALIKE)]
    return ("named" if len(near) == 1 else "ambiguous"), near


def within_noise(base: HypothesisFit) -> bool:
    """Whether a free rigid body leaves no more than the stated noise."""
    return rms(base.residual) < 1.0 + criteria.SHOWN / np.sqrt(2.0 * base.residual.size)


def may_be_named(c: Candidate, base: HypothesisFit, unknown: HypothesisFit) -> bool:
    """Whether an effect beats the unknown torque, explains most by itself, and is away from nothing."""
    if c.evidence < unknown.evidence + criteria.BEATS_UNKNOWN or c.evidence < base.evidence + criteria.BEATS_NOTHING:
        return False
    if rms(c.alone.residual) > criteria.PART_LEFT * rms(base.residual):
        return False
    if base.record.stated and rms(c.alone.residual) > criteria.LEFT_OF_STATED:
        return False
    return significance(c.best) < criteria.SIGNIFICANT


def significance(fit: HypothesisFit) -> float:
    """Chance of unknowns as far from nothing, all of an effect's together (Wald's test)."""
    from scipy.stats import chi2

    names = ["wheel"] if fit.hypothesis.wheel else [t.name for t in fit.hypothesis.terms]
    worst = 0.0
    for name in names:
        mean, covariance = fit.posterior.mean[name], fit.posterior.covariance[name]
        square = float(mean @ np.linalg.pinv(covariance, hermitian=True) @ mean)
        worst = max(worst, float(chi2.sf(square, len(mean))))
    return worst


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
