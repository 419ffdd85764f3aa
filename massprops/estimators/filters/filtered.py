"""From a problem to the estimate of the filter in body axes: what estimators have in common that differ in the update rule."""

from __future__ import annotations

from massprops.estimators.filters.begin import early_start
from massprops.estimators.filters.features import run_through
from massprops.estimators.filters.outcome import estimate_of
from massprops.estimators.filters.setup import setup
from massprops.estimators.filters.state import Settings
from massprops.estimators.result import Estimate, Prior
from massprops.estimators.start import Start
from massprops.model.problem import Problem


def filtered(name: str, problem: Problem, prior: Prior, start: Start, settings: Settings) -> Estimate:
    """The estimate of the filter in body axes with one update rule, begun from the first part of the data.

    Raises:
        NotPossible: the first guess found no rotation or no inertia.
    """
    ready = setup(problem, prior, early_start(problem, start))
    return estimate_of(name, problem, ready, run_through(problem, ready, settings))
