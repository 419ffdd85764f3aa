"""kabir2025 section 2.2: unscented Kalman filter for motion, inertia and features, in body axes, on any sequence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from massprops.estimators.result import Estimate, Prior
from massprops.model.problem import Problem

if TYPE_CHECKING:
    from massprops.estimators.start import Start

NAME = "ukf"
ORDER = 30
SENTENCE = "unscented Kalman filter for motion, k1, k2 and feature points (kabir2025)"
NEEDS = ("stereo|attitude|rates",)
BEGINS_EARLY = True


def estimate(problem: Problem, prior: Prior, start: Start) -> Estimate:
    """Motion and ratios by the filter, begun from the first part of the data.

    Raises:
        NotPossible: the first guess found no rotation or no inertia.
    """
    from massprops.estimators.filters.filtered import filtered
    from massprops.estimators.filters.state import UNSCENTED

    return filtered(NAME, problem, prior, start, UNSCENTED)
