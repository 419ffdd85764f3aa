"""Several records of one body: what each says of the inertia, joined, so that what one confounds another separates.

Everything else (attitudes, momenta at the start, a wheel's history, noise) is each record's own and already marginalised
in that record's fit. A record says of the inertia's shape s (`momentum_balance.inertia_of`) a normal posterior N(m_r, C_r)
from the prior N(0, P). With L_r = C_r^-1 and n records

    evidence = sum of the records' own + log of the integral of product_r [N(s; m_r, C_r) / N(s; 0, P)] N(s; 0, P) ds,

and the joint posterior has the precision sum L_r - (n - 1) P^-1: exact where the fits are linear in s. An effect that needs
another body in every record pays for it by the integral.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.momentum_balance import INERTIA, inertia_of
from massprops.diagnosis.selection import Candidate, Selection, may_be_named
from massprops.errors import NotPossible

LEAST_SD = 1e-4
"""Of a shape's posterior: no record shows a second moment of mass better than a part in ten thousand."""


@dataclass(frozen=True, kw_only=True)
class CommonInertia:
    """Attributes: shape (5,), its covariance (5, 5), inertia (3, 3) of trace 3; agreement: log of the integral above, by
    which the records' evidences together rise or fall when the inertia is one."""

    shape: np.ndarray
    covariance: np.ndarray
    inertia: np.ndarray
    agreement: float


@dataclass(frozen=True, kw_only=True)
class CommonEffect:
    """An effect tried in all records: its name, log evidence over the free body's of all records together, the inertia
    that they share, and the candidate of each record."""

    name: str
    evidence: float
    common: CommonInertia
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, kw_only=True)
class Together:
    """What several records say together: verdict as of one record, effects named, every effect tried, the most likely
    first, and the inertia of the verdict."""

    verdict: str
    named: tuple[CommonEffect, ...]
    tried: tuple[CommonEffect, ...]
    common: CommonInertia


def common_inertia(fits: list[HypothesisFit]) -> CommonInertia:
    """The inertia that several fits share."""
    means = [f.shape for f in fits]
    spreads = [f.posterior.covariance["base"][:INERTIA, :INERTIA] + LEAST_SD**2 * np.eye(INERTIA) for f in fits]
    return joined(means, spreads)


def joined(means: list[np.ndarray], spreads: list[np.ndarray]) -> CommonInertia:
    """The inertia that several posteriors of its shape, means (5,) and covariances (5, 5), share."""
    prior = np.eye(INERTIA) / criteria.SHAPE_SD**2
    precisions = [np.linalg.inv(c) for c in spreads]
    more = len(means) - 1
    whole = np.sum(precisions, axis=0) - more * prior
    by = np.sum([L @ m for L, m in zip(precisions, means, strict=True)], axis=0)
    shape = np.linalg.solve(whole, by)
    determinants = sum(np.linalg.slogdet(L)[1] for L in precisions) - more * np.linalg.slogdet(prior)[1]
    squares = sum(float(m @ L @ m) for L, m in zip(precisions, means, strict=True))
    agreement = 0.5 * (determinants - np.linalg.slogdet(whole)[1] + float(by @ shape) - squares)
    return CommonInertia(
        shape=shape, covariance=np.linalg.inv(whole), inertia=inertia_of(shape), agreement=float(agreement)
    )


def together(selections: list[Selection]) -> Together:
    """The verdict of several records of one body, which share its inertia."""
    base = common_inertia([s.base for s in selections])
    unknown = common_inertia([s.unknown for s in selections])
    nothing = sum(s.base.evidence for s in selections) + base.agreement
    tried = []
    for key in _in_all(selections):
        # a record that a free body explains had no effect tried: there it is idle
        own = tuple(next((c for c in s.tried if _key(c) == key), Candidate(alone=s.base)) for s in selections)
        common = common_inertia([c.best for c in own])
        evidence = sum(c.evidence for c in own) + common.agreement - nothing
        tried.append(CommonEffect(name=key[0], evidence=float(evidence), common=common, candidates=own))
    tried.sort(key=lambda e: -e.evidence)
    latent = sum(s.unknown.evidence for s in selections) + unknown.agreement - nothing
    if max([latent, *(e.evidence for e in tried)]) < criteria.BEATS_NOTHING + np.log(1 + len(tried)):
        return Together(verdict="none", named=(), tried=tuple(tried), common=base)
    good = [e for e in tried if e.evidence > latent + criteria.BEATS_UNKNOWN and _may_be_named(e, selections)]
    if not good:
        return Together(verdict="unexplained", named=(), tried=tuple(tried), common=unknown)
    near = tuple(e for e in good if e.evidence > good[0].evidence - criteria.ALIKE)
    verdict = "named" if len({e.name for e in near}) == 1 else "ambiguous"
    return Together(
        verdict=verdict, named=near if verdict != "named" else near[:1], tried=tuple(tried), common=near[0].common
    )


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
    if found.common.agreement < criteria.DISAGREE:
        raise NotPossible(
            f"the records do not agree on one inertia (log evidence {found.common.agreement:.0f}): they are of different bodies or in "
            "different body axes. Diagnose each by itself"
        )
    value, sigma = common_ratios(found.common)
    return {
        "format": "massprops-diagnoses/1",
        "verdict": found.verdict,
        "reason": _reason(found, len(names)),
        "effects": [_entry(e) for e in found.named],
        "candidates": [_entry(e) for e in found.tried],
        "inertia": found.common.inertia.tolist(),
        "k1": {"value": value[0], "sigma": sigma[0]},
        "k2": {"value": value[1], "sigma": sigma[1]},
        "agreement": found.common.agreement,
        "records": {n: d for n, d in zip(names, documents, strict=True)},
        "warnings": warnings,
    }


def common_ratios(common: CommonInertia) -> tuple[list[float], list[float]]:
    """(k1, k2) of a common inertia and their 1-sigma, by 400 draws from its posterior with a fixed seed."""
    from massprops.dynamics.inertia import ratios

    rng = np.random.default_rng(0)
    shapes = rng.multivariate_normal(common.shape, common.covariance, 400)
    k = np.array([ratios(inertia_of(s))[0] for s in shapes])
    return [float(v) for v in ratios(common.inertia)[0]], [float(v) for v in k.std(axis=0)]


def _entry(e: CommonEffect) -> dict[str, Any]:
    return {"name": e.name, "evidence": e.evidence, "agreement": e.common.agreement}


def _reason(found: Together, count: int) -> str:
    names = ", ".join(dict.fromkeys(e.name for e in found.named))
    return {
        "none": f"a free rigid body of one inertia explains the {count} records",
        "named": f"{names}, with one inertia in all {count} records",
        "ambiguous": f"these {count} records cannot tell apart: {names}",
        "unexplained": f"no effect of the catalogue explains the {count} records with one inertia",
    }[found.verdict]
