"""Which effect a record's rigid body lacks: every one in the catalogue by the balance of momentum, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import ModuleType

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.conserved_start import (
    Start,
    conserved,
    conserved_across,
    with_mean_moment_about_axis,
    with_more_about_axis,
)
from massprops.diagnosis.effect_columns import follows_measured, has_known_rate, in_balance, looked_at
from massprops.diagnosis.effect_search import (
    FirstLook,
    admissible,
    again,
    best_fit,
    best_fit_again,
    first_look,
    followed,
    widening,
)
from massprops.diagnosis.held_out import held_out_rms, noise_floor
from massprops.diagnosis.hypothesis_fit import SETTLED, Hypothesis, HypothesisFit, fit_hypothesis
from massprops.diagnosis.pairs import pairs
from massprops.diagnosis.record import Record
from massprops.diagnosis.scanned_values import at_likely_scale, with_scanned
from massprops.errors import NotPossible

Watch = Callable[[str, int, int], None]
LAGS = (0.02, 0.03, 0.045, 0.065, 0.1)
"""Time constants of a wheel tried, over the record's length: from what the knots of its drive can draw. On the odd flights,
whose wheel has one of about .07, evidence chose .03 to .045 and its size came within 7 % in 7 of 7; without a lag within
10 % in 5."""
MEMORIES = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Time constants of attitudes' errors that are tried, over the gap between two of them: from nearly none to what a short
record can show."""
VALLEY = (-0.3, -0.1, 0.1, 0.3, 0.6)
"""Moments about a wheel's axis, over the mean one, that are tried beside the one that a fit came to."""
SUN = "sun direction"
"""What effects need that follow the Sun."""
BESIDE_UNKNOWN = 4
"""Effects, the best by themselves, that are fitted beside a latent torque as well; and those that follow what was measured."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that was tried.

    Attributes:
        alone: fitted by itself; with_latent: together with a latent torque, or None where it was not worth it. told: the fit
            whose parameters are told, where it is another than the one that counts. alike: other laws of the same cause (`LAW_OF`)
            that the record does not tell from it.
    """

    alone: HypothesisFit
    with_latent: HypothesisFit | None = None
    told: HypothesisFit | None = None
    alike: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return " + ".join(self.alone.names)

    @cached_property
    def evidence(self) -> float:
        """Log evidence of what counts, paid for (`paid`)."""
        return paid(self.likeliest)

    @cached_property
    def own(self) -> float:
        """Log evidence of the effect by itself, paid for."""
        return paid(self.alone)

    @property
    def best(self) -> HypothesisFit:
        """What is told."""
        return self.likeliest if self.told is None else self.told

    @property
    def likeliest(self) -> HypothesisFit:
        """By itself where it leaves no more than the stated noise: nothing else is then needed, and an unknown torque beside it
        only takes a part of it. Else the more likely of the two."""
        if self.alone.record.stated and within_noise(self.alone):
            return self.alone
        if self.with_latent is not None and self.with_latent.verified > self.alone.verified:
            return self.with_latent
        return self.alone


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What was found.

    Attributes:
        base: the plain rigid body; unknown: with a latent torque; others: with one in inertial axes, and with one that depends on
            the Sun's direction in the body in any way where that is known; tried: effects, the most likely first.
        verdict: `none`, `named`, `ambiguous` or `unexplained`; named: the effects of the verdict; skipped: why others
            were not tried, by name. measured: effects that follow what was measured beside the motion.
    """

    base: HypothesisFit
    unknown: HypothesisFit
    tried: tuple[Candidate, ...]
    verdict: str
    named: tuple[Candidate, ...]
    skipped: dict[str, str] = field(default_factory=dict)
    others: tuple[HypothesisFit, ...] = ()
    measured: tuple[ModuleType, ...] = ()

    @property
    def unknowns(self) -> tuple[HypothesisFit, ...]:
        """The hypotheses that name nothing, which every effect must beat."""
        return (self.unknown, *self.others)

    @property
    def likeliest_unknown(self) -> HypothesisFit:
        """Of these the likeliest."""
        return max(self.unknowns, key=lambda f: f.evidence)

    @property
    def with_torque(self) -> HypothesisFit:
        """The unknown torque that is shown: what acts beside the effect that is named, or in place of any."""
        beside = self.named[0].with_latent if self.named else None
        return self.likeliest_unknown if beside is None else beside

    @property
    def noise(self) -> np.ndarray:
        """(3,) the noise that residuals are told in, over that of the rows."""
        with_latent = self.named[0].with_latent if self.named else None
        return noise_floor(self.unknown if with_latent is None else with_latent)


def select(record: Record, watch: Watch = lambda what, done, total: None) -> Selection:
    """The effect that a record's rigid body lacks."""
    watch("rigid body", 0, 1)
    base, unknown = without_effects(record)
    usable, skipped = usable_effects(record)
    measured = tuple(m for m in usable if follows_measured(m))
    if unknown is base:
        return Selection(base=base, unknown=base, tried=(), verdict="none", named=(), measured=measured)
    by_sun = torque_by_sun(record, unknown)
    others = tuple(f for f in (inertial_torque(record, unknown), by_sun) if f is not None)
    unknowns = (unknown, *others)
    tried = _by_themselves(record, base, unknowns, usable, watch)
    tried.sort(key=lambda c: -c.alone.evidence)
    for k, one in enumerate(tried):
        # what was measured acts, however little the rest of the motion lets it explain by itself
        measured = any(follows_measured(t.effect) for t in one.alone.hypothesis.terms)
        if one.with_latent is not None or not (k < BESIDE_UNKNOWN or measured):
            continue
        watch(f"beside an unknown torque: {one.name}", min(k, BESIDE_UNKNOWN - 1), BESIDE_UNKNOWN)
        tried[k] = Candidate(alone=one.alone, with_latent=_beside_unknown(record, one.alone, unknown))
    tried = _with_other_laws(record, base, tried)
    alike = _by_errors_alike(base, unknowns, tried)
    if alike is not None:
        return Selection(
            base=alike, unknown=alike, tried=tuple(tried), verdict="none", named=(), skipped=skipped, others=others,
            measured=measured,
        )  # fmt: skip
    if asks_for_two(tried, base, *unknowns):
        tried = _begun_again(record, base, unknown, tried, usable)
    if asks_for_two(tried, base, *unknowns):
        watch("two effects at once", 0, 1)
        tried += _pairs(tried, usable, base, unknowns)
    tried.sort(key=lambda c: -c.evidence)
    verdict, named = _verdict(base, unknowns, tried)
    if by_sun is not None and named and has_likelier_sun_torque(named[0].best, len(tried)):
        verdict, named = "unexplained", []
    likeliest = {id(c): _at_likely_scale(c) for c in named}
    tried, named = [likeliest.get(id(c), c) for c in tried], [likeliest[id(c)] for c in named]
    return Selection(
        base=base,
        unknown=unknown,
        tried=tuple(tried),
        verdict=verdict,
        named=tuple(_with_scanned(c, float(np.median(np.diff(record.times)))) for c in named),
        skipped=skipped,
        others=others,
        measured=measured,
    )


def _by_themselves(
    record: Record, base: HypothesisFit, unknowns: tuple[HypothesisFit, ...], usable: list[ModuleType], watch: Watch
) -> list[Candidate]:
    """Every effect by itself: what few passes like best first, so that what one effect which is enough rules out is not followed to its
    end."""
    along = record if record.rows.rates else unknowns[0].record
    looks: list[FirstLook | Candidate] = []
    if not any(map(has_known_rate, usable)):
        watch("balance of momentum: internal-rotor of any history", 0, len(usable))
        with suppress(NotPossible):
            looks.append(first_look_at_wheel(along))
    for k, effect in enumerate(usable):
        watch(f"balance of momentum: {effect.NAME}", k, len(usable))
        looks.append(first_look(record, effect, base))
    tried: list[Candidate] = []
    for look in sorted(looks, key=lambda one: -one.evidence if isinstance(one, FirstLook) else -one.alone.verified):
        least = _least(tried, base, unknowns)
        if isinstance(look, FirstLook):
            found = followed(record, look, base, least)
            tried += [] if found is None else [Candidate(alone=found)]
            continue
        with suppress(NotPossible):
            ruled_out = np.isfinite(least) and (
                look.best.verified < unknowns[0].evidence or look.alone.verified < least
            )
            tried.append(look if ruled_out else wheel_followed(along, look))
    return tried


def _least(tried: list[Candidate], base: HypothesisFit, unknowns: tuple[HypothesisFit, ...]) -> float:
    """Log evidence short of which an effect is not followed to its end; minus infinity where none is enough by itself."""
    enough = [c.own for c in tried if _is_enough(c.alone, unknowns)]
    return criteria.followed_from(base.evidence, max(enough)) if enough else -np.inf


def _is_enough(fit: HypothesisFit, unknowns: tuple[HypothesisFit, ...]) -> bool:
    """Whether effects leave no more than a stated noise and are likelier than what names nothing."""
    likeliest = max(u.evidence for u in unknowns) + criteria.BEATS_UNKNOWN
    return bool(fit.record.stated and within_noise(fit) and paid(fit) > likeliest)


def _beside_unknown(record: Record, alone: HypothesisFit, unknown: HypothesisFit) -> HypothesisFit | None:
    """An effect beside a latent torque. What follows a measurement leads astray more easily from its own solution, as the torque
    takes a part of it: it begins where the torque alone ends as well."""
    starts = [again(alone)]
    if any(follows_measured(t.effect) for t in alone.hypothesis.terms):
        starts.append(Start(inertia=unknown.inertia, left=1.0))
    fits = [admissible(record, alone.hypothesis, s, latent=True) for s in starts]
    return max((f for f in fits if f is not None), key=lambda f: f.verified, default=None)


def _begun_again(
    record: Record, base: HypothesisFit, unknown: HypothesisFit, tried: list[Candidate], usable: list[ModuleType]
) -> list[Candidate]:
    """With effects that begin at random once more, from other values, where these leave more than a stated noise."""
    out = list(tried)
    for effect in usable if record.stated else []:
        own = next((c for c in tried if c.name == effect.NAME), None)
        if own is not None and within_noise(own.alone):
            continue
        found = best_fit_again(record, effect, base)
        if found is not None and (own is None or found.verified > own.alone.verified + SETTLED):
            with_latent = _beside_unknown(record, found, unknown)
            out = [c for c in out if c is not own] + [Candidate(alone=found, with_latent=with_latent)]
    return out


def _with_other_laws(record: Record, base: HypothesisFit, tried: list[Candidate]) -> list[Candidate]:
    """With other laws of what leads, such as drag by the square of the rate: one that is likelier both by itself and beside an unknown
    torque is tried too, one that is neither more nor less likely in both is noted."""
    out = list(tried)
    for k, c in enumerate(tried[:BESIDE_UNKNOWN]):
        for effect in (m for m in in_balance() if c.name == getattr(m, "LAW_OF", None)):
            alone = best_fit(record, effect, base)
            if alone is None:
                continue
            other = Candidate(alone=alone, with_latent=admissible(record, alone.hypothesis, again(alone), latent=True))
            ahead = (other.evidence - c.evidence, alone.evidence - c.alone.evidence)
            if min(ahead) > criteria.ALIKE:
                out.append(other)
            elif max(ahead) > -criteria.ALIKE:
                out[k] = replace(c, alike=(*c.alike, str(effect.NAME)))
    return out


def _by_errors_alike(
    base: HypothesisFit, unknowns: tuple[HypothesisFit, ...], tried: list[Candidate]
) -> HypothesisFit | None:
    """The rigid body with errors of the attitudes that are alike in time, where nothing that acts is likelier by enough: it may
    have such errors too, and pays for the values that it was looked for at. Else None.

    What may not be named with independent errors, which speak for effects, has no say.
    """
    alike = with_memory(base)
    if alike is base:
        return None
    others = [*unknowns, *(c.best for c in tried if may_be_named(c, base, *unknowns))]
    enough = criteria.BEATS_NOTHING + np.log(1 + len(tried))
    if max(map(paid, others)) > alike.evidence + enough:
        return None
    return None if max(paid(with_memory(f)) for f in others) > alike.evidence + enough else alike


def paid(fit: HypothesisFit) -> float:
    """Log evidence, less the logarithm of the values at which an effect's time and the like were looked for: it is the best of so many,
    while an effect whose values are unknowns, as a spring's frequency, pays for them by their prior."""
    record = fit.record
    looked = [looked_at(t, record.times, record.path.w[record.rows.at]) for t in fit.hypothesis.terms]
    return float(fit.verified - np.sum(np.log(np.maximum(looked, 1))))


def with_memory(fit: HypothesisFit) -> HypothesisFit:
    """The fit with the likeliest time constant of the attitudes' errors; the fit itself where none is likelier."""
    if not fit.record.stated or fit.record.rows.rates:
        return fit
    best = fit
    for gaps in MEMORIES:
        with suppress(NotPossible):
            memory = gaps * float(np.median(np.diff(fit.record.times)))
            other = fit_hypothesis(fit.record, replace(fit.hypothesis, memory=memory), again(best))
            best = other if other.evidence > best.evidence else best
    return best


def _with_scanned(c: Candidate, gap: float) -> Candidate:
    """With what the record leaves open of what was scanned."""
    return _with_best(c, with_scanned(c.best, gap))


def _at_likely_scale(c: Candidate) -> Candidate:
    """With the least errors of a gyroscope that are likely: what is told of an effect depends on them, which one is named does not."""
    if any(follows_measured(t.effect) for t in c.alone.hypothesis.terms):
        return c if c.likeliest is c.alone else replace(c, told=_by_itself(c.alone))
    return _with_best(c, at_likely_scale(c.best))


def _by_itself(alone: HypothesisFit) -> HypothesisFit:
    """What is told of an effect that follows what was measured: an unknown torque beside it takes a part of what it explains (the
    size of a wheel came to 0.5 to 0.9 of what it is in seven flights), and errors of the gyroscope what it leaves (1.01 to 1.10,
    with hardly any 0.95 to 1.06). Its sigmas allow for what is left to be alike in neighbours."""
    own = replace(alone.hypothesis, scale=criteria.SCALES[0])
    fit = fit_hypothesis(alone.record, own, again(alone))
    widened = widening(fit.residual)
    wide = widened**2
    posterior = replace(fit.posterior, covariance={k: wide * v for k, v in fit.posterior.covariance.items()})
    return replace(
        fit, posterior=posterior, covariance={k: wide * v for k, v in fit.covariance.items()}, widened=widened
    )


def _with_best(c: Candidate, found: HypothesisFit) -> Candidate:
    if c.told is not None:
        return replace(c, told=found)
    return replace(c, with_latent=found) if c.best is c.with_latent else replace(c, alone=found)


def asks_for_two(tried: list[Candidate], base: HypothesisFit, *unknowns: HypothesisFit) -> bool:
    """Whether no single effect is enough: none may be named, or each that may leaves more than the noise that is stated, or
    an effect beside an unknown torque is likelier."""
    good = [c for c in tried if may_be_named(c, base, *unknowns)]
    if not base.record.stated:
        return not good
    likeliest = max(
        [
            *(u.evidence for u in unknowns),
            *(paid(f) for c in tried for f in (c.alone, c.with_latent) if f is not None),
        ]
    )
    enough = [c for c in good if within_noise(c.alone) and c.own > likeliest - criteria.BEATS_UNKNOWN]
    return bool(tried) and not enough


def _pairs(
    tried: list[Candidate], usable: list[ModuleType], base: HypothesisFit, unknowns: tuple[HypothesisFit, ...]
) -> list[Candidate]:
    """Pairs that are more likely than any single effect and any unknown torque, pay for having been looked for, and predict better.

    With a stated noise a single effect that may not be named counts by itself: what it gains beside an unknown torque is
    that torque's, and may be the second effect's.
    """
    record = base.record
    singles = sorted(tried, key=lambda c: -c.alone.evidence)
    if not singles:
        return []
    good = {c.name for c in tried if may_be_named(c, base, *unknowns)}
    alone = [c.alone for c in singles if not c.alone.hypothesis.wheel]
    found = pairs(record, unknowns[0], alone, usable, base.evidence, lambda fit: _is_enough(fit, unknowns))
    own = [c.own if record.stated and c.name not in good else c.evidence for c in tried]
    rivals = [*own, *(u.evidence for u in unknowns)]
    enough = max(rivals) + criteria.BEATS_NOTHING + np.log(1 + len(found))
    noise = np.ones(3)
    held = held_out_rms(singles[0].alone, noise)
    out = []
    for k, fit in enumerate(found):
        if paid(fit) > enough and not held_out_rms(fit, noise) > held:
            with_latent = admissible(record, fit.hypothesis, again(fit), latent=True) if k == 0 else None
            out.append(Candidate(alone=fit, with_latent=with_latent))
    return out


def without_effects(record: Record) -> tuple[HypothesisFit, HypothesisFit]:
    """The plain rigid body, and with a latent torque; the same twice where nothing is left that the stated noise does not
    explain."""
    plain = conserved(record.path, record.rows.at)
    base = _best(record, Hypothesis(latent=False), [plain, Start(inertia=np.eye(3), left=1.0)])
    if record.stated and within_noise(base):
        return base, base
    return base, _best(record, Hypothesis(), [plain, Start(inertia=base.inertia, left=1.0)])


def inertial_torque(record: Record, unknown: HypothesisFit) -> HypothesisFit | None:
    """With a torque that is smooth in inertial axes, such as that of a force from outside on a point near the axis; None where it
    leads astray."""
    along = record if record.rows.rates else unknown.record
    try:
        return fit_hypothesis(along, Hypothesis(latent=False, inertial=True), again(unknown))
    except NotPossible:
        return None


def torque_by_sun(record: Record, unknown: HypothesisFit) -> HypothesisFit | None:
    """With a torque that depends on the Sun's direction in the body in any way; beside a latent one where that leaves more
    than the noise and is likelier. None where nothing is known of the Sun, or where such torques lead astray, as a knock makes them.

    What acts may follow the Sun and be no pressure of its light: a jet of what it warms, a panel that bends.
    """
    if record.environment is None or SUN not in record.environment.known:
        return None
    along, fits = record if record.rows.rates else unknown.record, []
    for latent in (False, True):
        with suppress(NotPossible):
            fits.append(fit_hypothesis(along, Hypothesis(latent=latent, by_sun=True), again(unknown)))
        if fits and record.stated and within_noise(fits[0]):
            break
    return max(fits, key=lambda f: f.evidence, default=None)


def has_likelier_sun_torque(found: HypothesisFit, tried: int) -> bool:
    """Whether effects have a rival that names nothing of the Sun: a torque that depends on its direction in any way, in place of
    those that follow it and beside the others. A second effect may take what the first one cannot be.

    In place of one it must be less likely by as much as the best of so many is by chance; beside all it may be a little likelier, and
    is not asked where they leave no more than the stated noise, as of an unknown torque (`Candidate.best`). Of an effect alone
    that follows the Sun the verdict has asked.

    Args:
        tried: how many hypotheses the effects are the likeliest of.
    """
    own = found.hypothesis
    others = tuple(t for t in own.terms if SUN not in t.effect.NEEDS)
    replaced = len(others) < len(own.terms)
    alone = replaced and not (others or own.wheel)
    if alone or (not replaced and found.record.stated and within_noise(found)):
        return False
    try:
        rival = fit_hypothesis(found.record, replace(own, terms=others, by_sun=True), again(found))
    except NotPossible:
        return False
    lead = criteria.BEATS_UNKNOWN + np.log(1 + tried) if replaced else -criteria.BEATS_UNKNOWN
    return bool(rival.verified > found.evidence - lead)


def rigid_body_alone(record: Record) -> Selection:
    """Nothing but the plain rigid body, where no effect could be told."""
    base = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    return Selection(base=base, unknown=base, tried=(), verdict="none", named=())


def _best(record: Record, hypothesis: Hypothesis, starts: list[Start]) -> HypothesisFit:
    """The likeliest fit of one hypothesis from several starts, by what is verified: a fit that runs away to a needle claims more.

    Raises:
        NotPossible: none leads anywhere, nor does a ball.
    """
    fits = []
    for start in starts:
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, hypothesis, start))
    ball = replace(starts[0], inertia=np.eye(3))
    return max(fits, key=lambda f: f.verified) if fits else fit_hypothesis(record, hypothesis, ball)


def usable_effects(record: Record) -> tuple[list[ModuleType], dict[str, str]]:
    """The effects that the balance can hold with what is known about the record, and why others are left out."""
    known = set() if record.environment is None else set(record.environment.known)
    usable, skipped = [], {}
    for effect in in_balance():
        if hasattr(effect, "LAW_OF") or hasattr(effect, "BESIDE"):
            continue
        missing = [n for n in effect.NEEDS if n not in known]
        if missing:
            skipped[effect.NAME] = f"needs {', '.join(missing)}"
        else:
            usable.append(effect)
    return usable, skipped


def wheel_of_any_history(record: Record) -> Candidate:
    """A wheel of any history along one axis.

    Raises:
        NotPossible: no axis leads anywhere.
    """
    return wheel_followed(record, first_look_at_wheel(record))


def first_look_at_wheel(record: Record) -> Candidate:
    """A wheel that follows its drive at once beside a latent torque, which keeps it from answering for all, and one of a middle lag by
    itself, begun there.

    Raises:
        NotPossible: no axis leads anywhere.
    """
    start = conserved_across(record.path, record.rows.at)
    # the wheel answers for the moment about its axis: where its momentum changes least a ball may begin as a needle
    starts = [start, with_mean_moment_about_axis(start, record.path)]
    first = _best(record, Hypothesis(wheel=True), starts)
    alone = Hypothesis(wheel=True, latent=False, lag=float(np.median(LAGS)) * record.path.span)
    return Candidate(alone=fit_hypothesis(record, alone, again(first)), with_latent=first)


def wheel_followed(record: Record, look: Candidate) -> Candidate:
    """The wheel with the likeliest time constant of its drive, beside a latent torque first.

    Raises:
        NotPossible: the wheel by itself leads nowhere.
    """
    first = look.with_latent
    assert first is not None
    fits = []
    for lag in record.path.span * np.array(LAGS):
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, Hypothesis(wheel=True, lag=float(lag)), again(first)))
    # how the wheel follows its drive has no say in its axis: a fit that left it went astray
    fits = [f for f in fits if _apart(f, first) < criteria.AXIS_SD]
    with_latent = max(fits, key=lambda f: f.verified, default=first)
    alone = fit_hypothesis(record, replace(with_latent.hypothesis, latent=False), again(with_latent))
    alone = _along_valley(alone)
    if alone.verified > with_latent.verified:  # more freedom cannot be less likely: it went astray
        with_latent = fit_hypothesis(record, with_latent.hypothesis, again(alone))
    return Candidate(alone=alone, with_latent=with_latent)


def _along_valley(found: HypothesisFit) -> HypothesisFit:
    """The likeliest of a fit of a wheel and of fits begun at other moments about its axis, along which the likelihood hardly changes:
    the wheel answers for that moment."""
    best = found
    for more in VALLEY:
        with suppress(NotPossible):
            start = with_more_about_axis(again(found), found.rate, more)
            other = fit_hypothesis(found.record, found.hypothesis, start)
            best = other if other.verified > best.verified + SETTLED else best
    return best


def _apart(a: HypothesisFit, b: HypothesisFit) -> float:
    """Angle between the axes of two wheels [rad]."""
    assert a.axis is not None and b.axis is not None
    return float(np.arccos(min(1.0, abs(float(a.axis @ b.axis)))))


def _verdict(
    base: HypothesisFit, unknowns: tuple[HypothesisFit, ...], tried: list[Candidate]
) -> tuple[str, list[Candidate]]:
    something = max([*(u.evidence for u in unknowns), *(c.evidence for c in tried)])
    enough = criteria.BEATS_NOTHING + np.log(1 + len(tried))
    if something < base.evidence + enough:
        return "none", []
    good = _predicting([c for c in tried if _may_be_listed(c, base, unknowns)], base)
    if not good:
        return "unexplained", []
    near = [c for c in good if c.evidence > good[0].evidence - criteria.ALIKE]
    # what an unknown torque beside them hides: how much each explains by itself
    alone = max(near, key=lambda c: c.own)
    near = [alone, *(c for c in near if c is not alone and c.own > alone.own - criteria.ALIKE)]
    # of several effects one is a little likelier than a torque of any smooth form by chance
    smooth = max(u.evidence for u in unknowns if not u.hypothesis.by_sun)
    sure = good[0].evidence > smooth + enough and may_be_named(good[0], base, *unknowns)
    return ("named" if sure and len(near) == 1 else "ambiguous"), near


def _may_be_listed(c: Candidate, base: HypothesisFit, unknowns: tuple[HypothesisFit, ...]) -> bool:
    """Whether an effect may be named, or one by itself leaves no more than the stated noise and is not told from an unknown torque,
    which then is its rival."""
    single = len(c.alone.names) == 1 and base.record.stated and within_noise(c.alone)
    return may_be_named(c, base, *unknowns, lead=-criteria.ALIKE if single else criteria.BEATS_UNKNOWN)


def _predicting(candidates: list[Candidate], base: HypothesisFit) -> list[Candidate]:
    """The effects that predict what was held out better than the rigid body alone does; none where nothing was held out."""
    noise = np.ones(3)
    most = held_out_rms(base, noise) if candidates else np.nan
    return [c for c in candidates if held_out_rms(c.alone, noise) < most]


def within_noise(base: HypothesisFit) -> bool:
    """Whether a free rigid body leaves no more than the stated noise."""
    return bool(rms(base.residual) < 1.0 + criteria.SHOWN / np.sqrt(2.0 * base.residual.size))


def may_be_named(
    c: Candidate, base: HypothesisFit, *unknowns: HypothesisFit, lead: float = criteria.BEATS_UNKNOWN
) -> bool:
    """Whether an effect beats the unknown torques by so much in log evidence, explains most by itself, and is away from nothing."""
    likeliest = max(u.evidence for u in unknowns)
    if c.evidence < likeliest + lead or c.evidence < base.evidence + criteria.BEATS_NOTHING:
        return False
    small = base.record.stated and within_noise(c.alone)
    if not small and misfit(c.alone) > criteria.PART_LEFT * misfit(base):
        return False
    if base.record.stated and rms(c.alone.residual) > criteria.LEFT_OF_STATED:
        return False
    return significance(c.best) < criteria.SIGNIFICANT


def significance(fit: HypothesisFit) -> float:
    """Chance of unknowns as far from nothing, all of an effect's together (Wald's test)."""
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    names = (["wheel"] if fit.hypothesis.wheel else []) + [t.name for t in fit.hypothesis.terms]
    worst = 0.0
    for name in names:
        mean, covariance = fit.posterior.mean[name], fit.posterior.covariance[name]
        square = float(mean @ np.linalg.pinv(covariance, hermitian=True) @ mean)
        worst = max(worst, float(chdtrc(len(mean), square)))
    return worst


def misfit(fit: HypothesisFit) -> float:
    """What a fit leaves, root mean square over the noise given: beyond that noise where it is stated, as no effect can take the
    noise itself."""
    square = float(np.mean(fit.residual**2))
    return float(np.sqrt(max(square - 1.0, 0.0) if fit.record.stated else square))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
