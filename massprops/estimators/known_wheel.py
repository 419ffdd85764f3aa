"""A wheel of known rate (`rotor0`) in an estimate: a model to begin with, and what is said of methods that leave it out."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.inertia import DIRECTIONS, project_to_physical
from massprops.dynamics.quaternion import chained, multiply, rotation_matrix
from massprops.estimators.result import Estimate
from massprops.estimators.start import Start
from massprops.model import Model
from massprops.model.problem import Problem

STEPS = 12
LEAST_PART = 0.02
"""Of a body's second moments, in a start."""
LEFT_OUT = "it leaves out the wheel of rotor0, which turns inside the body; smoother takes it"


def model_of_wheel(wheel: ModuleType, problem: Problem, start: Start) -> Model:
    """The wheel with the inertia, momentum and rate that follow the measured rates best, begun at a ball.

    Rates are predicted from the balance R (I w + h) = L0, so that their noise stands in no column, along the start's attitudes, or
    along the measured rates where they are all there is: the start's are smooth over a wheel's run-up.
    """
    q, w = multiply(chaser_path(problem.environment, start.times).q, start.q), start.w
    if not problem.has_attitude and start.poses is None and start.index is not None:
        w = problem.rates[start.index]
        q = chained(0.5 * (w[1:] + w[:-1]) * np.diff(start.times)[:, None])
    turned = np.swapaxes(rotation_matrix(q), 1, 2)
    beside = np.concatenate([-wheel.momentum_columns(start.times, None, w, None)["internal"], turned], axis=2)

    def linear(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        A = np.linalg.inv(inertia) @ beside
        x = np.linalg.lstsq(A.reshape(-1, A.shape[2]), w.reshape(-1), rcond=None)[0]
        return x, A @ x, float(np.sum((w - A @ x) ** 2))

    inertia = np.eye(3) / 3.0
    x, predicted, cost = linear(inertia)
    for _ in range(STEPS):
        columns = np.concatenate([-np.einsum("aij,nj->nia", DIRECTIONS, predicted), beside], axis=2)
        A = (np.linalg.inv(inertia) @ columns).reshape(-1, columns.shape[2])
        step = np.linalg.lstsq(A, (w - predicted).reshape(-1), rcond=None)[0][:5]
        shares = (
            project_to_physical(inertia + f * np.einsum("a,aij->ij", step, DIRECTIONS), LEAST_PART)
            for f in 0.5 ** np.arange(6)
        )
        better = next((I for I in shares if linear(I)[2] < cost), None)
        if better is None:
            break
        inertia = better
        x, predicted, cost = linear(inertia)
    return Model((wheel,), (3.0 * x[:-3],), inertia, w[0])


def without_wheel(estimate: Estimate) -> Estimate:
    """An estimate by a method that leaves the wheel out: not reliable."""
    return replace(estimate, reliable=False, because=estimate.because or LEFT_OUT)
