"""Several records of one body: the inertia ratios that each method finds in all of them together.

Each record is estimated by itself, with a state and events of its own. What it says of the ratios is taken for a normal law, so
the product of these laws is what all say; the sum of squares about it tells whether one body can have them (chi-square, two
degrees of freedom a record beyond the first).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
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


@dataclass(frozen=True, kw_only=True)
class Together:
    """One method's ratios from several records.

    Attributes:
        name: of the method; k: (2,) ln(I1/I2), ln(I2/I3); covariance: (2, 2) of them; records: that it is reliable in; p_value: chance
            of ratios so far apart in records of one body.
    """

    name: str
    k: np.ndarray
    covariance: np.ndarray
    records: tuple[str, ...]
    p_value: float


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
    found = together(outcomes)
    joint = [
        Estimate(f.name, True, True, reliable=True, k1=f.k[0], k2=f.k[1], k_covariance=f.covariance) for f in found
    ]
    document: dict[str, Any] = {
        "format": "massprops-estimates-together/1",
        "estimators": [
            {"name": f.name, **e.ratios(), "p_value": f.p_value, "records": f.records}
            for f, e in zip(found, joint, strict=True)
        ],
        "records": {name: document_of(o, name) for name, o in outcomes.items()},
        "warnings": [f"{name}: {w}" for name, o in outcomes.items() for w in o.warnings],
    }
    return document, Outcome(next(iter(outcomes.values())).problem, joint, warnings=tuple(document["warnings"]))


def together(outcomes: dict[str, Outcome]) -> list[Together]:
    """What methods that are reliable in two records or more find in these together, the smoother first.

    Raises:
        NotPossible: there is none, or the first contradicts itself from one record to another.
    """
    own: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {}
    for record, outcome in outcomes.items():
        for e in outcome.sound:
            if e.k_covariance is not None:
                own.setdefault(e.name, {})[record] = np.array([e.k1, e.k2]), e.k_covariance
    found = [_together(name, laws) for name, laws in own.items() if len(laws) > 1]
    if not found:
        raise NotPossible("no method is reliable in two of the records: estimate each by itself, which says why")
    found.sort(key=lambda f: f.name != "smoother")
    if found[0].p_value < UNLIKELY:
        raise NotPossible(
            f"the records do not agree on one inertia by {found[0].name} (p = {found[0].p_value:.1g}): they are of different bodies, or "
            "something acts in one of them. Estimate each by itself"
        )
    return found


def _together(name: str, laws: dict[str, tuple[np.ndarray, np.ndarray]]) -> Together:
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    weights = [np.linalg.inv(covariance) for _, covariance in laws.values()]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    k = covariance @ np.sum([w @ own for w, (own, _) in zip(weights, laws.values(), strict=True)], axis=0)
    square = sum(float((own - k) @ w @ (own - k)) for w, (own, _) in zip(weights, laws.values(), strict=True))
    return Together(
        name=name, k=k, covariance=covariance, records=tuple(laws), p_value=float(chdtrc(2 * (len(laws) - 1), square))
    )  # fmt: skip
