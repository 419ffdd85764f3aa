"""Several records of one body: the inertia ratios that each method finds in all of them together.

Each record is estimated by itself, with a state and events of its own. What it says of the ratios is taken for a normal law, so
the product of these laws is what all say; the sum of squares about it tells whether one body can have them (chi-square, two
degrees of freedom a record beyond the first). Where a method finds numbers of the body beside the ratios, such as the moment of a wheel
whose rate was measured, the laws are those of both, with one more degree of freedom for each.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.estimators.documents import document as document_of
from massprops.estimators.estimate import estimate_all
from massprops.estimators.judgement import UNLIKELY
from massprops.estimators.outcome import Outcome
from massprops.estimators.result import Estimate, Prior
from massprops.sequence.data import Sequence

OWN_AXES = "own"
"""Body axes that an estimate chose for itself (`Estimate.body_frame`): parameters along axes do not compare there."""
DIFFER = (
    "the records agree on the ratios but not on what acts: its parameters are each record's own, as of another wheel"
)

Law = tuple[np.ndarray, np.ndarray]
"""(k,) values and their covariance (k, k)."""


@dataclass(frozen=True, kw_only=True)
class Together:
    """One method's ratios from several records.

    Attributes:
        name: of the method; k: (2,) ln(I1/I2), ln(I2/I3); covariance: (2, 2) of them; records: that it is reliable in; p_value: chance
            of ratios, and of what else is shared, so far apart in records of one body.
        parameters, sigma: of the body's own, by effect and name. differ: whether the records do not share these, so that the ratios
            alone are joined.
    """

    name: str
    k: np.ndarray
    covariance: np.ndarray
    records: tuple[str, ...]
    p_value: float
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    sigma: dict[str, dict[str, float]] = field(default_factory=dict)
    differ: bool = False


def estimate_several(
    records: list[Path | Sequence],
    methods: Iterable[str],
    prior: str | Path | Prior | None,
    model: str | Path | None,
    progress: Progress = silent,
) -> tuple[dict[str, Any], Outcome]:
    """`estimates.json` of several records of one body, and the joint estimates: k1, k2 and their covariance alone.

    Raises:
        InputError, NotPossible: see `estimate_all`; no method is reliable in two records, or they are not of one body.
    """
    chosen = list(methods)
    named = {str(r) if isinstance(r, Path) else f"record {k + 1}": r for k, r in enumerate(records)}
    outcomes = {name: estimate_all(record, chosen, prior, progress, model) for name, record in named.items()}
    combined = together(outcomes)
    joint = [
        Estimate(f.name, True, True, reliable=True, k1=f.k[0], k2=f.k[1], k_covariance=f.covariance) for f in combined
    ]
    document: dict[str, Any] = {
        "format": "massprops-estimates-together/1",
        "estimators": [
            {
                "name": f.name,
                **e.ratios(),
                "p_value": f.p_value,
                "records": f.records,
                "parameters": f.parameters,
                "sigma": f.sigma,
            }
            for f, e in zip(combined, joint, strict=True)
        ],
        "records": {name: document_of(o, name) for name, o in outcomes.items()},
        "warnings": [
            *(f"{name}: {w}" for name, o in outcomes.items() for w in o.warnings),
            *(f"{f.name}: {DIFFER}" for f in combined if f.differ),
        ],
    }
    return document, Outcome(next(iter(outcomes.values())).problem, joint, warnings=tuple(document["warnings"]))


def together(outcomes: dict[str, Outcome]) -> list[Together]:
    """What methods that are reliable in two records or more find in these together, the smoother first.

    Raises:
        NotPossible: there is none, or the first contradicts itself from one record to another.
    """
    by_method: dict[str, dict[str, Estimate]] = {}
    for record, outcome in outcomes.items():
        for e in outcome.sound:
            if e.k_covariance is not None:
                by_method.setdefault(e.name, {})[record] = e
    combined = [_together(name, estimates) for name, estimates in by_method.items() if len(estimates) > 1]
    if not combined:
        raise NotPossible("no method is reliable in two of the records: estimate each by itself, which says why")
    combined.sort(key=lambda f: f.name != "smoother")
    if combined[0].p_value < UNLIKELY:
        raise NotPossible(
            f"the records do not agree on one inertia by {combined[0].name} (p = {combined[0].p_value:.1g}): they are of different bodies, or "
            "something acts in one of them. Estimate each by itself"
        )
    return combined


def _together(name: str, estimates: dict[str, Estimate]) -> Together:
    """One method's estimates of several records: the ratios with what else they share, or alone where they do not share it."""
    every = list(estimates.values())
    names = [n for n in every[0].of_body if all(_has(e, n) for e in every)]
    x, covariance, p_value = _joined([_law(e, names) for e in every])
    differ = False
    if names and p_value < UNLIKELY:
        alone = _joined([_law(e, []) for e in every])
        differ = alone[2] >= UNLIKELY
        if differ:
            names, (x, covariance, p_value) = [], alone
    parameters: dict[str, dict[str, float]] = {}
    sigma: dict[str, dict[str, float]] = {}
    for k, (effect, number) in enumerate(names, 2):
        parameters.setdefault(effect, {})[number] = float(x[k])
        sigma.setdefault(effect, {})[number] = float(np.sqrt(covariance[k, k]))
    return Together(
        name=name, k=x[:2], covariance=covariance[:2, :2], records=tuple(estimates), p_value=p_value,
        parameters=parameters, sigma=sigma, differ=differ,
    )  # fmt: skip


def _has(e: Estimate, number: tuple[str, str]) -> bool:
    """Whether an estimate finds a number of the body in axes that the records share."""
    if number not in e.of_body or e.whole_covariance is None or e.body_frame == OWN_AXES:
        return False
    at = 2 + list(e.of_body).index(number)
    return bool(e.whole_covariance[at, at] > 0.0)


def _law(e: Estimate, names: list[tuple[str, str]]) -> Law:
    assert e.k_covariance is not None
    k = np.array([e.k1, e.k2], float)
    if not names:
        return k, e.k_covariance
    assert e.whole_covariance is not None
    at = [0, 1, *(2 + list(e.of_body).index(n) for n in names)]
    return np.array([*k, *(e.of_body[n] for n in names)]), e.whole_covariance[np.ix_(at, at)]


def _joined(laws: list[Law]) -> tuple[np.ndarray, np.ndarray, float]:
    """The product of normal laws (k,), its covariance (k, k), and the chance of means so far apart."""
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    weights = [np.linalg.inv(covariance) for _, covariance in laws]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    x = covariance @ np.sum([w @ mean for w, (mean, _) in zip(weights, laws, strict=True)], axis=0)
    square = sum(float((mean - x) @ w @ (mean - x)) for w, (mean, _) in zip(weights, laws, strict=True))
    return x, covariance, float(chdtrc(len(x) * (len(laws) - 1), square))
