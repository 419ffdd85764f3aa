"""volpe2017: relative pose, velocity, shape and inertia ratios from one camera and a range sensor."""

from __future__ import annotations

from typing import Any

from massprops.estimators.problem import Problem
from massprops.estimators.result import Estimate, Prior

NAME = "range-ukf"
ORDER = 45
SENTENCE = "one camera and ranges: batch fit to the first frames, then an unscented Kalman filter (volpe2017)"
NEEDS = ("tracks", "range")
NEEDS_START = False


def estimate(problem: Problem, prior: Prior, start: Any) -> Estimate:
    """Ratios, axes and metric motion.

    Raises:
        NotPossible: no rotation to start from, or the features cannot be placed.
    """
    from massprops.estimators.ranging.outcome import estimate_of
    from massprops.estimators.ranging.passage import passage_of, start_of

    begun = start_of(problem, prior, start)
    return estimate_of(NAME, problem, begun, passage_of(problem, prior, begun))
