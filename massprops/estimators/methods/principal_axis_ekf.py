"""hu2024: least-squares inertia, the unique principal frame, and an error-state EKF in that frame."""

from __future__ import annotations

from typing import Any

from massprops.errors import NotPossible
from massprops.estimators.problem import Problem
from massprops.estimators.result import Estimate, Prior

NAME = "principal-axis-ekf"
ORDER = 60
SENTENCE = "least-squares inertia, one principal frame for good, then an extended Kalman filter in it (hu2024)"
NEEDS = ("stereo|attitude",)


def estimate(problem: Problem, prior: Prior, start: Any) -> Estimate:
    """Ratios, axes and motion by the filter, from the least-squares start.

    Raises:
        NotPossible: the start found no rotation or no inertia.
    """
    from massprops.estimators.begin import restlessness
    from massprops.estimators.principal.follow import followed
    from massprops.estimators.principal.outcome import estimate_of

    if start.inertia is None or start.w is None or not len(start.q):
        raise NotPossible(f"{NAME}: no rotation could be found to start from")
    points = problem.stereo and start.features is not None and start.position is not None
    if not points and not problem.has_attitude:
        raise NotPossible(f"{NAME}: neither stereo points nor attitude0 to filter")
    run = followed(problem, prior, start, *restlessness(problem, prior, start))
    return estimate_of(NAME, problem, start, run)
