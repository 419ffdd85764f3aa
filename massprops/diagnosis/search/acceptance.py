"""Which fitted models are accepted: whether they explain and predict the data, and need each of their effects."""

from __future__ import annotations

import numpy as np

from massprops.diagnosis.search.event_time import EVIDENCE
from massprops.diagnosis.search.refit import FittedModel
from massprops.diagnosis.search.residual_statistics import WHITE

MISPREDICTED = 1.5
"""Held-out residual over the noise at which a model that fits does not predict."""
PREDICTS = 1.12
"""Held-out residual over the noise up to which nothing better is looked for."""
PATH_PREDICTS = 1.1
"""The same up to which no other path than a free fall beside the chaser is looked for."""
HINT = 2.0
"""Score of the correlation between neighbours that hints at structure where a model predicts badly."""
WORSE = 0.01
"""Rise of the held-out residual over the noise with which an effect is still believed."""
ENOUGH = 1.02
"""Root-mean-square residual at which nothing is left to explain, whatever its correlation."""
NOISY = 1.3
"""Root-mean-square residual that can still be noise stated too low, when neighbours are not alike."""


def explained(s: FittedModel) -> bool:
    """Nothing but noise is left."""
    return fits(s) and not s.held >= MISPREDICTED


def fits(s: FittedModel) -> bool:
    """The residuals of the fitted data are white and about as large as the noise."""
    return bool(s.fitted < ENOUGH or (s.white < WHITE and s.fitted < NOISY))


def adequate(s: FittedModel) -> bool:
    """Explained, and not such that a structure in what is left and a poor prediction both speak for something more."""
    return explained(s) and not (s.held > PREDICTS and s.white > HINT)


def acceptable(s: FittedModel, base: FittedModel) -> bool:
    """Plausible, better than the base model by more than the evidence asked for, and predicting no worse."""
    predicts = not np.isfinite(s.held) or s.held < base.held + WORSE
    return bool(not s.implausible and np.isfinite(s.bic) and base.bic - s.bic > EVIDENCE and predicts)


def all_needed(pair: FittedModel, singles: list[FittedModel]) -> bool:
    """Backward check: neither effect of a pair is idle beside the other, nor spoils what the other predicts."""
    return all(
        s.bic - pair.bic > EVIDENCE and not pair.held > s.held + WORSE
        for s in singles
        if set(s.names) < set(pair.names)
    )


def distinct(models: list[FittedModel]) -> list[FittedModel]:
    """The best model of each set of names."""
    seen: dict[frozenset[str], FittedModel] = {}
    for s in sorted(models, key=lambda s: s.bic):
        seen.setdefault(frozenset(s.names), s)
    return list(seen.values())


def penalised_bic(s: FittedModel) -> float:
    """BIC and a penalty for each effect, the evidence that it must bring; lower is better."""
    return s.bic + EVIDENCE * len(s.added)
