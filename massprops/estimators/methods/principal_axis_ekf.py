"""hu2024: least-squares inertia, the unique principal frame, and an error-state EKF in that frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from massprops.estimators.result import Estimate, Prior
from massprops.model.problem import Problem

if TYPE_CHECKING:
    from massprops.estimators.start import Start

NAME = "principal-axis-ekf"
ORDER = 60
SENTENCE = "least-squares inertia, one principal frame for good, then an extended Kalman filter in it (hu2024)"
NEEDS = ("stereo|attitude",)
MOST_FEATURES = 24
"""Features carried at a time."""


def estimate(problem: Problem, prior: Prior, start: Start) -> Estimate:
    """Ratios, axes and motion by the filter, from the least-squares start.

    Raises:
        NotPossible: the start found no rotation or no inertia.
    """
    from massprops.estimators.filters.features import run_through
    from massprops.estimators.filters.outcome import estimate_of
    from massprops.estimators.filters.principal_axes import in_principal_axes
    from massprops.estimators.filters.setup import setup
    from massprops.estimators.filters.state import ITERATED
    from massprops.estimators.unique_frame import unique_frame

    if not problem.stereo:
        # what one camera's tracks leave open of depth makes a filter in principal axes surer than it is
        problem = replace(problem, uv=problem.uv[:, :, :0], features=problem.features[:0])
    ready = in_principal_axes(setup(problem, prior, start, MOST_FEATURES), unique_frame)
    return estimate_of(NAME, problem, ready, run_through(problem, ready, ITERATED, most=MOST_FEATURES))
