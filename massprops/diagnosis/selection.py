"""Which effect a record's rigid body lacks: every one in the catalogue by the balance of momentum, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Candidate, Selection, paid, within_noise
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import follows_measured, has_known_rate, in_balance
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
from massprops.diagnosis.held_out import held_out_rms
from massprops.diagnosis.hypothesis_fit import SETTLED, HypothesisFit, fit_hypothesis
from massprops.diagnosis.pairs import pairs
from massprops.diagnosis.record import Record
from massprops.diagnosis.scanned_values import at_likely_scale, with_scanned
from massprops.diagnosis.unnamed import (
    has_likelier_sun_torque,
    inertial_torque,
    torque_by_sun,
    with_memory,
    without_effects,
)
from massprops.diagnosis.verdict import asks_for_two, is_enough, may_be_named, verdict_of
from massprops.diagnosis.wheel_of_any_history import first_look_at_wheel, wheel_followed
from massprops.errors import NotPossible

Watch = Callable[[str, int, int], None]
BESIDE_UNKNOWN = 4
"""Effects, the best by themselves, that are fitted beside a latent torque as well; and those that follow what was measured."""


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
    verdict, named = verdict_of(base, unknowns, tried)
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
            effect_fit = followed(record, look, base, least)
            tried += [] if effect_fit is None else [Candidate(alone=effect_fit)]
            continue
        with suppress(NotPossible):
            ruled_out = np.isfinite(least) and (
                look.best.verified < unknowns[0].evidence or look.alone.verified < least
            )
            tried.append(look if ruled_out else wheel_followed(along, look))
    return tried


def _least(tried: list[Candidate], base: HypothesisFit, unknowns: tuple[HypothesisFit, ...]) -> float:
    """Log evidence short of which an effect is not followed to its end; minus infinity where none is enough by itself."""
    enough = [c.own for c in tried if is_enough(c.alone, unknowns)]
    return criteria.followed_from(base.evidence, max(enough)) if enough else -np.inf


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
        tried_before = next((c for c in tried if c.name == effect.NAME), None)
        if tried_before is not None and within_noise(tried_before.alone):
            continue
        fit_again = best_fit_again(record, effect, base)
        if fit_again is not None and (
            tried_before is None or fit_again.verified > tried_before.alone.verified + SETTLED
        ):
            with_latent = _beside_unknown(record, fit_again, unknown)
            out = [c for c in out if c is not tried_before] + [Candidate(alone=fit_again, with_latent=with_latent)]
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
    pair_fits = pairs(record, unknowns[0], alone, usable, base.evidence, lambda fit: is_enough(fit, unknowns))
    single_evidences = [c.own if record.stated and c.name not in good else c.evidence for c in tried]
    rivals = [*single_evidences, *(u.evidence for u in unknowns)]
    enough = max(rivals) + criteria.BEATS_NOTHING + np.log(1 + len(pair_fits))
    noise = np.ones(3)
    held = held_out_rms(singles[0].alone, noise)
    out = []
    for k, fit in enumerate(pair_fits):
        if paid(fit) > enough and not held_out_rms(fit, noise) > held:
            with_latent = admissible(record, fit.hypothesis, again(fit), latent=True) if k == 0 else None
            out.append(Candidate(alone=fit, with_latent=with_latent))
    return out


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
    hypothesis = replace(alone.hypothesis, scale=criteria.SCALES[0])
    fit = fit_hypothesis(alone.record, hypothesis, again(alone))
    widened = widening(fit.residual)
    wide = widened**2
    posterior = replace(fit.posterior, covariance={k: wide * v for k, v in fit.posterior.covariance.items()})
    return replace(
        fit, posterior=posterior, covariance={k: wide * v for k, v in fit.covariance.items()}, widened=widened
    )


def _with_best(c: Candidate, fit: HypothesisFit) -> Candidate:
    if c.told is not None:
        return replace(c, told=fit)
    return replace(c, with_latent=fit) if c.best is c.with_latent else replace(c, alone=fit)
