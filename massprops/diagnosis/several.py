"""Several records of one body, so that what one confounds another separates: which effect they lack together.

Each is diagnosed by itself; what is common comes from all of them (`common_parameters`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Candidate, Selection
from massprops.diagnosis.common_parameters import Common, common_of
from massprops.diagnosis.effect_columns import Term, follows_measured, has_known_rate
from massprops.diagnosis.effect_search import admissible, again
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.record_agreement import Shared, own_numbers, shared_numbers, stretch
from massprops.diagnosis.verdict import may_be_named
from massprops.effects import effects
from massprops.errors import NotPossible

ONE_RECORD = "a law (--discover) and a simulator (--simulator) are looked for in one record: give each record by itself"
"""What is refused with several."""


@dataclass(frozen=True, kw_only=True)
class _OfAll:
    """Something of which records share what is `common`."""

    common: Common

    @cached_property
    def shared(self) -> list[Shared]:
        """What each record tells of the numbers that they share."""
        return shared_numbers(self.common)

    @cached_property
    def stretch(self) -> float:
        """Factor on the common sigmas by which the records scatter."""
        return stretch(self.common)


@dataclass(frozen=True, kw_only=True)
class CommonEffect(_OfAll):
    """An effect tried in all records: its name, log evidence over the free body's of all records together, what they share, the
    candidate of each record, and by how much their evidences together rise or fall by sharing it. What counts, and what is shared, are
    as `Candidate` has them: not always of one fit. apart: the body's numbers that each record has of its own, as they differ."""

    name: str
    evidence: float
    candidates: tuple[Candidate, ...]
    agreement: float
    apart: tuple[Shared, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Together(_OfAll):
    """What several records say together: verdict as of one record, effects named, every effect tried, the most likely
    first, what is common under the verdict, and by how much the records' evidences rise or fall by sharing it. likeliest: log evidence
    of all records under the likeliest that was tried; split: where nothing explains them all, the effect that explains each by itself, or
    None."""

    verdict: str
    named: tuple[CommonEffect, ...]
    tried: tuple[CommonEffect, ...]
    agreement: float
    likeliest: float = 0.0
    split: CommonEffect | None = None


def agreement(common: Common, fits: list[HypothesisFit]) -> float:
    """By how much the log evidences of records together rise or fall when they share what is common."""
    return common.evidence - sum(f.evidence for f in fits)


def together(selections: list[Selection]) -> Together:
    """The verdict of several records of one body, which share its inertia and its parameters, and the axes of their sensors unless they
    are likelier by far with these turned in the body from record to record.

    Raises:
        NotPossible: no body comes near all records.
    """
    tried = {key: candidates for key in _in_all(selections) if (candidates := _in_each(key, selections))}
    tried = _other_laws(tried, selections) | tried
    same = _judged(selections, tried, axes=False)
    try:
        turned = _judged(selections, tried, axes=True)
    except NotPossible:
        return same
    return turned if turned.likeliest > same.likeliest + criteria.TURNED else same


def _judged(
    selections: list[Selection], in_each: dict[tuple[str, bool], tuple[Candidate, ...]], axes: bool
) -> Together:
    """The verdict with one set of axes for all sensors, or with axes that turn.

    Raises:
        NotPossible: no body comes near all records.
    """
    bases, latents = [s.base for s in selections], [s.unknown for s in selections]
    base, unknown = _base(bases, axes), common_of(latents, axes)
    tried = []
    for (name, _), candidates in in_each.items():
        with suppress(NotPossible):
            tried.append(_common_effect(name, candidates, base, axes))
    tried.sort(key=lambda e: -e.evidence)
    latent = unknown.evidence - base.evidence
    most = max([latent, *(e.evidence for e in tried)])
    likeliest = base.evidence + max(most, 0.0)
    if most < criteria.BEATS_NOTHING + np.log(1 + len(tried)):
        return _found("none", (), tried, base, (agreement(base, bases), likeliest))
    good = [e for e in tried if e.evidence > latent + criteria.BEATS_UNKNOWN and _may_be_named(e, selections)]
    if not good:
        verdict = _found("unexplained", (), tried, unknown, (agreement(unknown, latents), likeliest))
        return replace(verdict, split=_split(tried, selections, latent - verdict.agreement))
    near = tuple(e for e in good if e.evidence > good[0].evidence - criteria.ALIKE)
    single = len({e.name for e in near}) == 1
    first = near[0]
    return _found(
        "named" if single else "ambiguous",
        near[:1] if single else near,
        tried,
        first.common,
        (first.agreement, likeliest),
    )


def _base(bases: list[HypothesisFit], axes: bool) -> Common:
    """The free body in all records, with axes that turn where it comes to rest with them."""
    with suppress(NotPossible):
        return common_of(bases, axes)
    return common_of(bases)


def _split(tried: list[CommonEffect], selections: list[Selection], latent: float) -> CommonEffect | None:
    """The likeliest effect that may be named in each record with a body of its own; latent: log evidence over the common free body of
    an unknown torque in each, with a body of its own."""
    with_own_bodies = [
        e for e in tried
        if e.agreement < criteria.DISAGREE and e.evidence - e.agreement > latent and _may_be_named(e, selections)
    ]  # fmt: skip
    return max(with_own_bodies, key=lambda e: e.evidence - e.agreement, default=None)


def _found(
    verdict: str,
    named: tuple[CommonEffect, ...],
    tried: list[CommonEffect],
    common: Common,
    counts: tuple[float, float],
) -> Together:
    """counts: by how much sharing raises the evidences, and the likeliest evidence."""
    alike, likeliest = counts
    return Together(
        verdict=verdict, named=named, tried=tuple(tried), common=common, agreement=alike, likeliest=likeliest
    )


def _in_each(key: tuple[str, bool], selections: list[Selection]) -> tuple[Candidate, ...]:
    """An effect in each record. One that a free body explains had none tried: an effect of the body acts there too, another one
    is idle. Nothing where no body comes near such a record with the effect.
    """
    candidates = [next((c for c in s.tried if _key(c) == key), None) for s in selections]
    known = next(c.best for c in candidates if c is not None)
    with suppress(NotPossible):
        return tuple(_candidate(c, s, known) for c, s in zip(candidates, selections, strict=True))
    return ()


def _common_effect(name: str, candidates: tuple[Candidate, ...], base: Common, axes: bool) -> CommonEffect:
    """An effect in all records, over their free body; axes: whether those of the sensors turn.

    What is told of an effect may come from another fit than the one that counts, beside a torque that takes a part of it: there
    nothing that follows a measurement is shared. Elsewhere it is, as a wheel's moment, unless the records are likelier by far if each has its own.

    Raises:
        NotPossible: no common body comes near the records.
    """
    fits, told = [c.likeliest for c in candidates], [c.best for c in candidates]
    measured = any(follows_measured(t.effect) for f in fits for t in f.hypothesis.terms)
    alone = all(c.told is None for c in candidates)
    counts = common_of([_apart(f) for f in fits] if measured else fits, axes)
    common = counts if alone else common_of(told, axes)
    differ = measured and alone
    if differ:
        with suppress(NotPossible):
            one = common_of(fits, axes)
            if one.evidence > counts.evidence + criteria.DISAGREE:
                counts, common, differ = one, one, False
    return CommonEffect(
        name=name, evidence=counts.evidence - base.evidence, common=common, candidates=candidates, agreement=agreement(counts, fits),
        apart=tuple(own_numbers(told)) if differ else (),
    )  # fmt: skip


def _other_laws(
    tried: dict[tuple[str, bool], tuple[Candidate, ...]], selections: list[Selection]
) -> dict[tuple[str, bool], tuple[Candidate, ...]]:
    """In each record, the other laws of a cause that some of them do not tell from the one that was tried: together they may."""
    out = {}
    for candidates in tried.values():
        for law in dict.fromkeys(name for c in candidates for name in c.alike):
            with suppress(NotPossible):
                known = [next((o for o in s.tried if o.name == law), None) for s in selections]
                both = zip(known, candidates, selections, strict=True)
                out[law, False] = tuple(_by_law(law, c, s) if k is None else k for k, c, s in both)
    return out


def _by_law(law: str, c: Candidate, s: Selection) -> Candidate:
    """Another law in place of a candidate's, by itself and beside an unknown torque.

    Raises:
        NotPossible: it leads nowhere in the record.
    """
    record = s.base.record
    hypothesis = replace(c.likeliest.hypothesis, terms=(Term(effect=effects()[law]),))
    alone = admissible(record, hypothesis, again(c.likeliest), latent=False)
    if alone is None:
        raise NotPossible(f"{law} leads nowhere in a record")
    return Candidate(alone=alone, with_latent=admissible(record, hypothesis, again(alone), latent=True))


def _apart(fit: HypothesisFit) -> HypothesisFit:
    """A fit of which records share nothing that follows what was measured."""
    terms = tuple(replace(t, apart=follows_measured(t.effect)) for t in fit.hypothesis.terms)
    return replace(fit, hypothesis=replace(fit.hypothesis, terms=terms))


def _candidate(candidate: Candidate | None, s: Selection, known: HypothesisFit) -> Candidate:
    if candidate is not None:
        return candidate
    # a wheel's rate is another one in every record
    wheels = tuple(Term(effect=m) for m in s.measured if has_known_rate(m))
    terms = tuple(t for t in known.hypothesis.terms if t.of_body and not has_known_rate(t.effect))
    terms += wheels if any(has_known_rate(t.effect) for t in known.hypothesis.terms) else ()
    if not terms:
        return Candidate(alone=s.base)
    return Candidate(alone=fit_hypothesis(s.base.record, Hypothesis(terms=terms, latent=False), again(s.base)))


def _may_be_named(effect: CommonEffect, selections: list[Selection]) -> bool:
    """Whether it may be named in most of the records that lack something."""
    lacking = [(c, s) for c, s in zip(effect.candidates, selections, strict=True) if s.verdict != "none"]
    passed = [may_be_named(c, s.base, *s.unknowns) for c, s in lacking]
    return 2 * sum(passed) > len(passed)


def _key(c: Candidate) -> tuple[str, bool]:
    return c.name, c.alone.hypothesis.wheel


def _in_all(selections: list[Selection]) -> list[tuple[str, bool]]:
    tried = [{_key(c): None for c in s.tried} for s in selections if s.tried]
    return [k for k in tried[0] if all(k in o for o in tried[1:])] if tried else []
