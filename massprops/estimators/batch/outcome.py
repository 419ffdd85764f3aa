"""From a batch fit to the estimate that every method gives."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import from_rotation_matrix, multiply
from massprops.effects import of_body
from massprops.estimators.attitude_information import hidden_by
from massprops.estimators.batch.solve import Fit, covariance_of
from massprops.estimators.batch.start import BatchStart
from massprops.estimators.judgement import INCOMPLETE
from massprops.estimators.result import Estimate
from massprops.model import Model
from massprops.model.linearise import Slopes
from massprops.model.problem import Problem
from massprops.model.state import BODY_SIZE, INERTIA, ratio_jacobian

LARGEST_SIGMA_K = 0.18
"""1-sigma of k1 or k2 above which the data say too little: half their spread over all bodies that there can be."""
MISFIT = 2.0
"""Chi-square over freedom beyond which the model does not explain the data."""


def estimate_of(
    name: str,
    problem: Problem,
    first: BatchStart,
    found: Fit,
    environment: EnvironmentModel,
    seconds: float,
    rival: str | None = None,
    covariance: np.ndarray | None = None,
) -> Estimate:
    """The fit as an `Estimate`, with the covariance (size, size) of its parameters where it is not the plain one."""
    state, motion = found.state, found.predicted.motion
    covariance = covariance_of(found) if covariance is None else covariance
    k, axes, slopes, turns = ratio_jacobian(state.inertia)
    block = covariance[INERTIA, INERTIA]
    k_covariance, axes_covariance = slopes @ block @ slopes.T, turns @ block @ turns.T
    turn = float(np.sqrt(np.max(np.diag(axes_covariance))))
    hidden = rival or hidden_by(np.sqrt(np.diag(k_covariance)), turn, state.w0, axes, LARGEST_SIGMA_K)
    numbers, by = _of_body(state.model, slopes)
    tracked = "tracks" in first.channels
    sigma = _sigmas(problem, found, environment, covariance)
    cam = motion.turn
    placed = first.observed.any(axis=(0, 1)) if first.observed.size else np.zeros(len(problem.features), bool)
    return Estimate(
        name=name,
        converged=bool(found.converged and np.isfinite(found.cost)),
        observable=not hidden,
        reason=hidden or _unfit(found),
        k1=None if hidden else float(k[0]),
        k2=None if hidden else float(k[1]),
        k_covariance=k_covariance,
        inertia=state.inertia / 3.0,
        principal_axes=None if hidden else axes,
        axes_covariance=None if hidden else axes_covariance,
        times=problem.times,
        q=multiply(from_rotation_matrix(cam), found.predicted.q),
        w=motion.w,
        position=np.einsum("nij,nj->ni", cam, motion.r) if tracked else None,
        velocity=np.einsum("nij,nj->ni", cam, motion.v) if tracked else None,
        sigma_attitude=sigma[0],
        sigma_w=sigma[1],
        sigma_position=sigma[2] if tracked else None,
        sigma_velocity=sigma[3] if tracked else None,
        features=state.points[placed] if tracked else None,
        feature_ids=problem.features[placed] if tracked else None,
        body_frame=first.body_frame,
        innovation=float(found.chi2 / found.freedom),
        gated=int((found.weights == 0).sum()),
        used=int(found.count),
        cpu_us_per_step=1e6 * seconds / len(problem.times),
        warnings=first.notes,
        of_body=numbers,
        whole_covariance=by @ covariance @ by.T,
    )


def _of_body(model: Model, slopes: np.ndarray) -> tuple[dict[tuple[str, str], float], np.ndarray]:
    """The body's numbers that a model's effects have, and derivatives (2 + m, size) of k1, k2 and these by the state's parameters."""
    sizes = [len(v) for v in model.values]
    ends = BODY_SIZE + np.cumsum([0, *sizes])
    numbers: dict[tuple[str, str], float] = {}
    rows = [np.concatenate([np.zeros(INERTIA.start), s, np.zeros(ends[-1] - BODY_SIZE)]) for s in slopes]
    for effect, value, at in zip(model.modules, model.values, ends, strict=False):
        for k, q in enumerate(effect.PARAMETERS):
            if q.name in of_body(effect):
                word, factor = of_body(effect)[q.name]
                numbers[effect.NAME, word] = float(value[k] / factor)
                rows.append(np.eye(ends[-1])[at + k] / factor)
    return numbers, np.array(rows)


def _sigmas(
    problem: Problem, found: Fit, environment: EnvironmentModel, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """1-sigma (n, 3) of attitude, rates, position and velocity."""
    by = Slopes(problem, found.predicted, environment)

    def spread(J: np.ndarray, rows: np.ndarray) -> np.ndarray:
        block = covariance[np.ix_(rows, rows)]
        return np.asarray(np.sqrt(np.maximum(np.einsum("nij,jk,nik->ni", J, block, J), 0.0)))

    at = found.predicted
    turning, path = by.turn_columns, by.path_columns
    return spread(by.turn, turning), spread(by.rate, turning), spread(at.dr, path), spread(at.dv, path)


def _unfit(found: Fit) -> str:
    """Why the fit does not explain the data; empty when it does."""
    if not (found.converged and np.isfinite(found.cost)):
        return f"the fit did not settle in {found.iterations} iterations"
    reduced_chi2 = found.chi2 / found.freedom
    if reduced_chi2 > MISFIT:
        return f"residuals are {np.sqrt(reduced_chi2):.2g} times the stated noise: {INCOMPLETE}"
    return ""
