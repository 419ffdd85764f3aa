"""A law discovered in one record: its terms, its fit as an effect like any other, its figures, its effect file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import within_noise
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.discovery.effect_source import effect_of, source_of
from massprops.diagnosis.discovery.library import (
    STEPS,
    Group,
    LibraryTerm,
    columns_of,
    library,
    own_frequencies,
    told_apart,
)
from massprops.diagnosis.discovery.regression import (
    Found,
    Regression,
    distinct,
    idle,
    probabilities,
    regression_of,
    search,
)
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.held_out import fitted_rms, held_out_rms, noise_floor
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.momentum_balance import Balance, torque_forcing
from massprops.diagnosis.record import Record

LIKELY = 0.75
"""Probability of each of its terms from which a law is stated as one."""
ROUNDS = 6
"""Fits after which the library is looked through again; more than one only for the moments at which terms begin."""
NEAR = 9
"""Moments tried about such a one, from one neighbour to the next: four times as fine with each round."""


@dataclass(frozen=True, kw_only=True)
class Against:
    """What the catalogue names in a law's record, and by how much log evidence the law is ahead of it once both have paid for
    what they were looked for among."""

    names: tuple[str, ...]
    ahead: float


@dataclass(frozen=True, kw_only=True)
class Law:
    """A law and what speaks for it.

    Attributes:
        terms: of the torque, with their probability (k,); effect: as an effect file holds it; source: that file.
        rivals: terms that lack one of the law's and explain the record nearly as well, with their log evidence over that of
            the likeliest.
        price: log evidence that the terms cost for the size of the library; catalogue: what it names, or None.
        alone: the joint refit of the whole record; with_latent: the same together with a latent torque; base, unknown: without it.
    """

    terms: tuple[LibraryTerm, ...]
    probability: np.ndarray
    rivals: tuple[tuple[tuple[LibraryTerm, ...], float], ...]
    price: float
    effect: ModuleType
    source: str
    alone: HypothesisFit
    with_latent: HypothesisFit
    base: HypothesisFit
    unknown: HypothesisFit
    catalogue: Against | None = None

    @property
    def evidence(self) -> float:
        """Log evidence of the better of the two fits."""
        return max(self.alone.evidence, self.with_latent.evidence)

    @property
    def objection(self) -> str:
        """Why the law is not to be stated; empty when it is."""
        if self.evidence < self.base.evidence + criteria.BEATS_NOTHING:
            return "a free rigid body explains the record as well"
        if self.evidence < self.unknown.evidence + criteria.BEATS_UNKNOWN:
            return "an unknown torque explains the record better"
        if self.alone.record.stated and not within_noise(self.alone):
            return (
                f"it leaves residuals of {rms(self.alone.residual):.2f} times the stated noise: something else acts too"
            )
        if self.probability.min() < LIKELY:
            return "other terms explain the record nearly as well: it does not tell them apart"
        if self.catalogue is not None and self.catalogue.ahead < 0.0:
            return f"{' + '.join(self.catalogue.names)} of the catalogue is likelier, by {-self.catalogue.ahead:.1f} in log evidence"
        return ""


def discover(record: Record, base: HypothesisFit, unknown: HypothesisFit) -> Law | None:
    """The law that the rows of a record ask for; None where they ask for none.

    Args:
        base: the plain rigid body's fit; unknown: with a latent torque.

    Raises:
        NotPossible: the refit leads nowhere.
    """
    grid = record.path.span / STEPS
    steps = tuple(float(record.times[0] + grid * k) for k in range(1, STEPS))
    at = unknown
    for last in (False,) * ROUNDS + (True,):
        groups, torques = _library(at, steps)
        terms = [term for group in groups for term in group.terms]
        r = _regression(at, groups, torques)
        models = search(r)
        columns = models[0].columns
        if not columns:
            return None
        law_terms = tuple(terms[c] for c in columns)
        used = sorted({term.moment for term in law_terms if term.moment is not None})
        if not last and (used or at is unknown):  # a fit, to look again along the path that it finds
            at = _fitted(record, effect_of(source_of(law_terms, [1e-4] * len(law_terms))), unknown)
            near = [float(s + grid * d) for s in used for d in np.linspace(-1.0, 1.0, NEAR)]
            steps, grid = tuple(sorted({*steps, *near})), 0.5 * grid
            continue
        alike = _alike(terms, columns, record.path.span / STEPS)
        chance = probabilities(r, models, alike)
        while (out := idle(r, columns, chance)) is not None:
            columns = tuple(c for c in columns if c != out)
        sure = np.array([chance[c] for c in columns])
        law = _refit(record, tuple(terms[c] for c in columns), sure, base, unknown)
        behind = {k: v - models[0].score for k, v in distinct(models, alike).items() if not set(columns) <= k}
        rivals = [(tuple(terms[c] for c in sorted(k)), v) for k, v in behind.items() if v > -criteria.ALIKE]
        price = sum(p for group, p in zip(r.groups, r.prices, strict=True) if set(group) & set(columns))
        return replace(law, rivals=tuple(rivals), price=float(price))
    return None


def _library(at: HypothesisFit, steps: tuple[float, ...]) -> tuple[list[Group], np.ndarray]:
    """The groups of terms for what is known of a record that differ along the path of a fit, and their torques (n, 3, k)."""
    record = at.record
    known = set() if record.environment is None else set(record.environment.known)
    frequencies = own_frequencies(record.times, record.path.w[record.rows.at])
    every = library(known, record.path.span, frequencies, steps, float(np.median(np.diff(record.times))))
    terms = [term for group in every for term in group.terms]
    return told_apart(every, columns_of(terms, record.path, at.rate, record.environment_state))


def _regression(at: HypothesisFit, groups: list[Group], torques: np.ndarray) -> Regression:
    """The rows of a record about one fit, with the columns of every term's torque (n, 3, k)."""
    record = at.record
    balance = Balance(
        path=record.path, shape=at.shape, momentum=at.rate @ at.inertia, rate=at.rate, rows=record.rows
    )  # fmt: skip
    columns = balance.columns(torque_forcing(record.path, torques))
    noise = at.row_noise
    plain = [b for b in at.blocks if b.name in ("base", "gyroscope")]
    fixed = np.concatenate([b.columns for b in plain], axis=1) / noise[:, None]
    sd = np.concatenate([at.posterior.sd[b.name] for b in plain])
    over = 1.0 / (record.rows.spread * noise)
    members, at_column = [], 0
    for group in groups:
        members.append(tuple(range(at_column, at_column + len(group.terms))))
        at_column += len(group.terms)
    return regression_of(
        fixed, sd, columns.reshape(len(over), -1) * over[:, None], at.y / noise, record.noise_rows, tuple(members),
        tuple(g.least for g in groups), tuple(sorted({g.kind for g in groups}).index(g.kind) for g in groups),
    )  # fmt: skip


def _refit(
    record: Record, terms: tuple[LibraryTerm, ...], probability: np.ndarray, base: HypothesisFit, unknown: HypothesisFit
) -> Law:
    effect = effect_of(source_of(terms, [1e-4] * len(terms)))
    # one size of the torques, since coefficients in other units have none in common
    torques = columns_of(list(terms), unknown.record.path, unknown.rate, record.environment_state)
    units = np.diag(1.0 / np.sqrt(np.mean(np.sum(torques**2, axis=1), axis=0)))
    effect.__dict__["momentum_prior"] = lambda: units
    alone = max((_fitted(record, effect, near) for near in (unknown, base)), key=lambda f: f.evidence)
    with_latent = _fitted(record, effect, alone, latent=True)
    values = alone.values[effect.NAME]
    source = source_of(terms, [float(v) for v in values])
    return Law(
        terms=terms, probability=probability, rivals=(), price=0.0, effect=effect, source=source, alone=alone,
        with_latent=with_latent, base=base, unknown=unknown,
    )  # fmt: skip


def _fitted(record: Record, effect: ModuleType, near: HypothesisFit, latent: bool = False) -> HypothesisFit:
    """The joint fit of the whole record with a law's effect, begun from another fit's inertia."""
    hypothesis = Hypothesis(terms=(Term(effect=effect),), latent=latent)
    return fit_hypothesis(record, hypothesis, Start(inertia=near.inertia, left=1.0))


def _alike(terms: list[LibraryTerm], columns: tuple[int, ...], reach: float) -> dict[int, int]:
    """Terms that begin within `reach` [s] of one of the law's, along the same axis, by that one's column."""
    out = {}
    for k, term in enumerate(terms):
        near = []
        for c in columns:
            used = terms[c]
            if term.moment is None or used.moment is None or term.axis != used.axis:
                continue
            if abs(term.moment - used.moment) < reach:
                near.append((abs(term.moment - used.moment), c))
        if near:
            out[k] = min(near)[1]
    return out


def document_of_law(law: Law | None) -> dict[str, Any]:
    """`law` in `diagnosis.json`."""
    if law is None:
        return {"formula": None, "terms": [], "stated": False, "because": "the record asks for no term of the library"}
    name = law.effect.NAME
    values = law.alone.values[name]
    sigma = np.sqrt(np.maximum(np.diag(law.alone.covariance[name]), 0.0))
    noise = noise_floor(law.with_latent)
    held = {"before": held_out_rms(law.base, noise), "after": held_out_rms(law.alone, noise)}
    return {
        "formula": formula(law.terms, values),
        "stated": not law.objection,
        "because": law.objection or None,
        "terms": [
            {
                "term": t.label,
                "coefficient": float(v),
                "sigma": float(s),
                "unit": t.unit,
                "probability": float(p),
                "same_here": list(t.same),
            }
            for t, v, s, p in zip(law.terms, values, sigma, law.probability, strict=True)
        ],
        "rivals": [{"terms": [t.label for t in terms], "log_evidence": float(v)} for terms, v in law.rivals],
        "catalogue": None
        if law.catalogue is None
        else {"effects": list(law.catalogue.names), "log_evidence": law.catalogue.ahead},
        "evidence": law.evidence - law.base.evidence,
        "evidence_against_unknown": law.evidence - law.unknown.evidence,
        "fitted": {"before": fitted_rms(law.base, noise), "after": fitted_rms(law.alone, noise)},
        "held_out": {k: v if np.isfinite(v) else None for k, v in held.items()},
        "effect": "law.py",
        "model": "law.yaml",
    }


def formula(terms: tuple[LibraryTerm, ...], values: np.ndarray) -> str:
    """The torque over the mean moment, body axes, SI."""
    return "torque = " + " ".join(
        f"{'+' if v >= 0 else '-'} {abs(v):.4g} [{t.label}]" for t, v in zip(terms, values, strict=True)
    ).removeprefix("+ ")


def model_of_law(law: Law) -> dict[str, Any]:
    """`law.yaml`: a model with the law's effect, which `--model` reads beside `--effect law.py`."""
    name = law.effect.NAME
    sigma = np.sqrt(np.maximum(np.diag(law.alone.covariance[name]), 0.0))
    parameters = law.effect.PARAMETERS
    values = law.alone.values[name]
    return {
        "format": "massprops-model/1",
        "effects": [
            {
                "name": name,
                "parameters": {q.name: float(v) for q, v in zip(parameters, values, strict=True)},
                "units": {q.name: q.unit for q in parameters},
                "sigma": {q.name: float(v) for q, v in zip(parameters, sigma, strict=True)},
            }
        ],
        "inertia": law.alone.inertia.tolist(),
        "angular_velocity_rad_s": law.alone.rate[0].tolist(),
        "attitude": law.alone.record.path.q[0].tolist(),
    }


__all__ = ["Found", "Law", "discover", "document_of_law", "formula", "model_of_law"]
