"""Several records of one body, so that what one confounds another separates: which effect they lack together.

Each is diagnosed by itself; what is common comes from all of them (`common_parameters`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.common_parameters import Common, common_of
from massprops.diagnosis.effect_search import again
from massprops.diagnosis.hypothesis_fit import Hypothesis, HypothesisFit, fit_hypothesis
from massprops.diagnosis.momentum_balance import inertia_of
from massprops.diagnosis.selection import Candidate, Selection, may_be_named
from massprops.errors import NotPossible

ONE_RECORD = "a law (--discover) and a simulator (--simulator) are looked for in one record: give each record by itself"
"""What is refused with several."""


@dataclass(frozen=True, kw_only=True)
class CommonEffect:
    """An effect tried in all records: its name, log evidence over the free body's of all records together, what they share, the
    candidate of each record, and by how much their evidences together rise or fall by sharing it. What counts, and what is shared, are
    as `Candidate` has them: not always of one fit."""

    name: str
    evidence: float
    common: Common
    candidates: tuple[Candidate, ...]
    agreement: float

    @property
    def told_apart(self) -> bool:
        """Whether what each record tells of it lies further apart than its sigmas have it."""
        return agreement(self.common, [c.best for c in self.candidates]) < criteria.DISAGREE


@dataclass(frozen=True, kw_only=True)
class Together:
    """What several records say together: verdict as of one record, effects named, every effect tried, the most likely
    first, what is common under the verdict, and by how much the records' evidences rise or fall by sharing it."""

    verdict: str
    named: tuple[CommonEffect, ...]
    tried: tuple[CommonEffect, ...]
    common: Common
    agreement: float


def agreement(common: Common, fits: list[HypothesisFit]) -> float:
    """By how much the log evidences of records together rise or fall when they share what is common."""
    return common.evidence - sum(f.evidence for f in fits)


def together(selections: list[Selection]) -> Together:
    """The verdict of several records of one body, which share its inertia and its parameters.

    Raises:
        NotPossible: no body comes near all records.
    """
    bases, latents = [s.base for s in selections], [s.unknown for s in selections]
    base, unknown = common_of(bases), common_of(latents)
    tried = []
    for key in _in_all(selections):
        with suppress(NotPossible):
            own = _in_each(key, selections)
            counts = common_of([c.likeliest for c in own])
            # what is told of an effect may come from another fit than the one that counts
            common = counts if all(c.told is None for c in own) else common_of([c.best for c in own])
            evidence = counts.evidence - base.evidence
            alike = agreement(counts, [c.likeliest for c in own])
            tried.append(CommonEffect(name=key[0], evidence=evidence, common=common, candidates=own, agreement=alike))
    tried.sort(key=lambda e: -e.evidence)
    latent = unknown.evidence - base.evidence
    if max([latent, *(e.evidence for e in tried)]) < criteria.BEATS_NOTHING + np.log(1 + len(tried)):
        return _found("none", (), tried, base, agreement(base, bases))
    good = [e for e in tried if e.evidence > latent + criteria.BEATS_UNKNOWN and _may_be_named(e, selections)]
    if not good:
        return _found("unexplained", (), tried, unknown, agreement(unknown, latents))
    near = tuple(e for e in good if e.evidence > good[0].evidence - criteria.ALIKE)
    single = len({e.name for e in near}) == 1
    first = near[0]
    return _found(
        "named" if single else "ambiguous", near[:1] if single else near, tried, first.common, first.agreement
    )


def _found(
    verdict: str, named: tuple[CommonEffect, ...], tried: list[CommonEffect], common: Common, alike: float
) -> Together:
    return Together(verdict=verdict, named=named, tried=tuple(tried), common=common, agreement=alike)


def _in_each(key: tuple[str, bool], selections: list[Selection]) -> tuple[Candidate, ...]:
    """An effect in each record. One that a free body explains had none tried: an effect of the body acts there too, another one
    is idle.

    Raises:
        NotPossible: with the effect no body comes near such a record.
    """
    own = [next((c for c in s.tried if _key(c) == key), None) for s in selections]
    known = next(c.best for c in own if c is not None)
    return tuple(_candidate(c, s, known) for c, s in zip(own, selections, strict=True))


def _candidate(own: Candidate | None, s: Selection, known: HypothesisFit) -> Candidate:
    if own is not None:
        return own
    terms = tuple(t for t in known.hypothesis.terms if t.of_body)
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


def document_of_together(found: Together, names: list[str], documents: list[dict[str, Any]]) -> dict[str, Any]:
    """The content of `diagnosis.json` of several records.

    Args:
        names: of the records; documents: of each by itself.

    Raises:
        NotPossible: the records are not of one body.
    """
    warnings = [f"{n}: {w}" for n, d in zip(names, documents, strict=True) for w in d["warnings"]]
    apart = "the records differ by more than the sigmas of what each tells: those of k1 and k2 are of their scatter"
    warnings += [f"{e.name}: {apart}" for e in found.named if e.told_apart]
    if found.agreement < criteria.DISAGREE:
        what = " and ".join(["one inertia", *sorted({f"one {n}" for e in found.named for n in e.common.parameters})])
        raise NotPossible(
            f"the records do not agree on {what} (log evidence {found.agreement:.0f}): they are of different bodies or in "
            "different body axes. Diagnose each by itself"
        )
    value, sigma = common_ratios(found.common)
    if any(e.told_apart for e in found.named):
        sigma = np.maximum(sigma, scatter(found.named[0])).tolist()
    return {
        "format": "massprops-diagnoses/1",
        "verdict": found.verdict,
        "reason": _reason(found, len(names)),
        "effects": [_entry(e) for e in found.named],
        "candidates": [_entry(e) for e in found.tried],
        "inertia": found.common.inertia.tolist(),
        "k1": {"value": value[0], "sigma": sigma[0]},
        "k2": {"value": value[1], "sigma": sigma[1]},
        "agreement": found.agreement,
        "records": {n: d for n, d in zip(names, documents, strict=True)},
        "warnings": warnings,
    }


def scatter(effect: CommonEffect) -> np.ndarray:
    """(2,) 1-sigma of a mean of k1 and k2, from what each record tells by itself."""
    from massprops.dynamics.inertia import ratios

    k = np.array([ratios(c.best.inertia)[0] for c in effect.candidates])
    return np.asarray(k.std(axis=0, ddof=1) / np.sqrt(len(k)))


def common_ratios(common: Common) -> tuple[list[float], list[float]]:
    """(k1, k2) of a common inertia and their 1-sigma, by 400 draws from its posterior with a fixed seed."""
    from massprops.dynamics.inertia import ratios

    rng = np.random.default_rng(0)
    shapes = rng.multivariate_normal(common.shape, common.covariance, 400)
    k = np.array([ratios(inertia_of(s))[0] for s in shapes])
    return [float(v) for v in ratios(common.inertia)[0]], [float(v) for v in k.std(axis=0)]


def _entry(e: CommonEffect) -> dict[str, Any]:
    """What an effect scores, and the parameters of it that are the body's, None for those that the records do not show."""
    shown = {
        effect: {n: v if abs(v) > criteria.SHOWN * e.common.sigma[effect][n] else None for n, v in own.items()}
        for effect, own in e.common.parameters.items()
    }
    return {
        "name": e.name,
        "evidence": e.evidence,
        "agreement": e.agreement,
        "parameters": shown,
        "sigma": {
            effect: {n: None if v is None else e.common.sigma[effect][n] for n, v in own.items()}
            for effect, own in shown.items()
        },
    }


def _reason(found: Together, count: int) -> str:
    names = ", ".join(dict.fromkeys(e.name for e in found.named))
    shared = any(own for e in found.named for own in e.common.parameters.values())
    return {
        "none": f"a free rigid body of one inertia explains the {count} records",
        "named": f"{names}, with one inertia{' and its parameters the same' if shared else ''} in all {count} records",
        "ambiguous": f"these {count} records cannot tell apart: {names}",
        "unexplained": f"no effect of the catalogue explains the {count} records with one inertia",
    }[found.verdict]
