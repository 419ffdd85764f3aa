"""pesce2017: extended Kalman filter, in body axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from massprops.estimators.result import Estimate, Prior
from massprops.model.problem import Problem

if TYPE_CHECKING:
    from massprops.estimators.start import Start

NAME = "ekf"
ORDER = 20
SENTENCE = "extended Kalman filter for motion, inertia and feature points (pesce2017)"
NEEDS = ("stereo|attitude|rates",)
BEGINS_EARLY = True


def estimate(problem: Problem, prior: Prior, start: Start) -> Estimate:
    """Motion and ratios by the filter, begun from the first part of the data.

    Raises:
        NotPossible: the first guess found no rotation or no inertia.
    """
    from massprops.estimators.filters.filtered import filtered
    from massprops.estimators.filters.state import EXTENDED

    return filtered(NAME, problem, prior, start, EXTENDED)
