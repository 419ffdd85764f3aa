"""Batch least squares over the whole record with the shared model: the reference for all other methods.

Initial state, inertia, centre of mass, feature points and any effects of a model are found together by
Levenberg-Marquardt with variational equations; it reaches the noise limit (Cramér-Rao) if the model is right.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import project_to_physical
from massprops.estimators.batch import matched_tracks
from massprops.estimators.batch.halves import halves, residual_rows
from massprops.estimators.batch.outcome import estimate_of
from massprops.estimators.batch.rivals import best_of_rivals
from massprops.estimators.batch.solve import InertiaPrior, costs_alike, fit
from massprops.estimators.batch.start import batch_start
from massprops.estimators.result import Estimate, Prior
from massprops.model import Model
from massprops.model.measurements import measurements_of
from massprops.model.problem import Problem
from massprops.model.state import BODY_SIZE, BatchState

if TYPE_CHECKING:
    from massprops.estimators.start import Start

NAME = "smoother"
ORDER = 5
SENTENCE = "batch least squares over the whole record, from the least-squares and momentum start"
NEEDS = ("stereo|attitude|rates",)


def estimate(problem: Problem, prior: Prior, start: Start, model: Model | None = None) -> Estimate:
    """Motion, inertia ratios and axes with their covariance.

    Args:
        model: effects that act besides free rotation, with their parameters as a start (`model.yaml`).

    Raises:
        NotPossible: no attitude to begin with.
    """
    begun = time.process_time()
    environment = EnvironmentModel(problem.environment, compiled=True)  # many integrations are to come
    first = batch_start(problem, start, environment)
    if matched_tracks.applies(problem, start):
        first, fitted, m = matched_tracks.fit_tracks(problem, first, start, environment, model)
        fitted, rival = best_of_rivals(problem, m, fitted, environment, InertiaPrior())
        covariance = matched_tracks.clustered_covariance(problem, m, fitted, environment)
        told = estimate_of(NAME, problem, first, fitted, environment, time.process_time() - begun, rival, covariance)
        return replace(told, memory_counted=True)
    state, free = first.state, first.free
    if model is not None and model.modules:
        state = replace(state, model=model)
        free = np.concatenate([free, np.ones(state.size - BODY_SIZE, bool)])
    m = measurements_of(problem, observed=first.observed, channels=first.channels)
    belief = InertiaPrior()
    if prior.inertia is not None and prior.attitude:
        sigma = 0.05 if prior.k_sigma is None else float(np.max(prior.k_sigma))
        belief = InertiaPrior(3.0 * prior.inertia / np.trace(prior.inertia), max(sigma, 1e-6))
    fitted = fit(problem, m, state, environment, free, belief)
    model_state = _state_of_model(state, model, problem)
    if model_state is not None:
        # the model's own state is near its minimum; the usual start need not lie in the same valley
        both = [fitted, fit(problem, m, model_state, environment, free, belief)]
        fitted = both[int(np.argmin(costs_alike(both, m)))]
    fitted, rival = best_of_rivals(problem, m, fitted, environment, belief)
    told = estimate_of(NAME, problem, first, fitted, environment, time.process_time() - begun, rival)
    if told.converged and told.observable:
        told = replace(
            told, residuals=residual_rows(problem, m, fitted), halves=halves(problem, m, fitted, environment)
        )
    return replace(told, cpu_us_per_step=1e6 * (time.process_time() - begun) / len(problem.times))


def _state_of_model(state: BatchState, model: Model | None, problem: Problem) -> BatchState | None:
    """The state in which `model.yaml` says that the record begins; None where it says nothing."""
    if model is None or model.rate is None or model.inertia is None:
        return None
    q0 = state.q0 if model.attitude is None or not problem.has_attitude else model.attitude
    return replace(state, q0=q0, w0=model.rate, inertia=3.0 * project_to_physical(model.inertia))
