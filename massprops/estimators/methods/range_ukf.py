"""volpe2017: relative pose, velocity, shape and inertia ratios from one camera and a range sensor."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.estimators.filters.verdict import LARGEST_SQUARE
from massprops.estimators.result import Estimate, Prior
from massprops.model.problem import Problem

if TYPE_CHECKING:
    from massprops.estimators.start import Start

NAME = "range-ukf"
ORDER = 45
SENTENCE = "one camera and ranges: batch fit to the first frames, then an unscented Kalman filter (volpe2017)"
NEEDS = ("tracks", "range")
NEEDS_START = False


def estimate(problem: Problem, prior: Prior, start: Start) -> Estimate:
    """Ratios, axes and metric motion.

    Raises:
        NotPossible: no rotation to start from, or the features cannot be placed.
    """
    from massprops.estimators.filters.outcome import estimate_of
    from massprops.estimators.ranging.passage import passage_of, start_of

    ready, passage, fit = passage_of(problem, prior, start_of(problem, start))
    filter_estimate = estimate_of(NAME, problem, ready, passage)
    unfit = unfit_of(fit)
    if unfit and not filter_estimate.reason:
        filter_estimate = replace(filter_estimate, converged=False, reason=unfit)
    return replace(filter_estimate, gated=filter_estimate.gated + fit.outliers, used=filter_estimate.used + fit.rows)


def unfit_of(fit: Any) -> str:
    """Why the fit to the first frames is not to be believed; empty when it may be."""
    if not fit.converged:
        return "the fit to the first frames did not settle: they do not determine the motion and the inertia together"
    if fit.square > LARGEST_SQUARE:
        return f"the fit to the first frames leaves residuals of {np.sqrt(fit.square):.1f} sigma"
    return ""
