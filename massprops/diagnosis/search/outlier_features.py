"""Outlier features, whose tracks a fit rejects: placed anew, and left out when that does not help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.diagnosis.search.case import Case, without_features
from massprops.diagnosis.search.refit import FittedModel, refit
from massprops.estimators.batch.start import place_points

THROWN = 0.3
"""Share of a feature's tracks without weight at which the feature, not a track, is wrong."""
MOST = 0.4
"""Share of the features beyond which the fit is wrong, not they."""


def without_outlier_features(case: Case, base: FittedModel) -> tuple[Case, FittedModel]:
    """The base model with its misplaced features placed anew by the motion found, or without them.

    A point far from its place has all its tracks gated out, and nothing then moves it back.
    """
    wrong = _thrown_out(case, base)
    if not wrong.any():
        return case, base
    points = np.where(wrong[:, None], np.nan, base.fit.state.points)
    state, _ = place_points(case.problem, replace(base.fit.state, points=points), case.environment, case.first.observed)
    again = refit(case, state, (), most=40)
    if again.bic < base.bic:
        base = again
    wrong = _thrown_out(case, base)
    if not wrong.any():
        return case, base
    fewer = without_features(case, wrong)
    return fewer, refit(fewer, base.fit.state, (), most=40)


def _thrown_out(case: Case, base: FittedModel) -> np.ndarray:
    """(m,) which features are wrong; none when too many seem to be."""
    m = case.fitted
    count = case.first.observed.shape[2]
    if not len(m.uv):
        return np.zeros(count, bool)
    gone = np.bincount(m.seen.feature, base.fit.weights[: len(m.uv)] == 0, minlength=count)
    seen = np.bincount(m.seen.feature, minlength=count)
    wrong = gone > THROWN * np.maximum(seen, 1)
    return wrong if wrong.sum() <= MOST * (seen > 0).sum() else np.zeros(count, bool)
