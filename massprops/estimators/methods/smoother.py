"""Batch least squares over the whole record with the shared model: the reference for all other methods.

Initial state, inertia, centre of mass, feature points and any effects of a model are found together by
Levenberg-Marquardt with variational equations; the noise limit (Cramer-Rao) is what it reaches where the model holds.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import from_rotation_matrix, multiply
from massprops.dynamics.sensitivities import sensitivities
from massprops.dynamics.surroundings import Surroundings
from massprops.estimators.batch import one_camera
from massprops.estimators.batch.halves import halves, residual_rows
from massprops.estimators.batch.linearise import inertia_directions
from massprops.estimators.batch.measurements import Measurements, measurements_of
from massprops.estimators.batch.solve import Belief, Fit, covariance_of, fit
from massprops.estimators.batch.start import BatchStart, batch_start
from massprops.estimators.batch.state import BatchState, physical, ratio_slopes
from massprops.estimators.problem import Problem
from massprops.estimators.result import Estimate, Prior
from massprops.model import Model

NAME = "smoother"
ORDER = 5
SENTENCE = "batch least squares over the whole record, from the least-squares and momentum start"
NEEDS = ("stereo|attitude|rates",)
LARGEST_SIGMA_K = 0.18
"""1-sigma of k1 or k2 above which the data say too little: half their spread over all bodies that there can be."""
LARGEST_SIGMA_AXES = 0.5
"""1-sigma [rad] of a turn of the principal axes above which they are undetermined."""
NEARLY_FLAT = 0.15
"""Largest turn [rad] of the angular velocity in the body below which rival inertias are tried."""
RIVAL_CHI2 = 12.0
"""Difference of chi-square within which a rival explains the data as well."""
MISFIT = 2.0
"""Chi-square over freedom beyond which the model does not explain the data."""


def estimate(problem: Problem, prior: Prior, start: Any, model: Model | None = None) -> Estimate:
    """Motion, inertia ratios and axes with their covariance.

    Args:
        model: effects that act besides free rotation, with their parameters as a start (`model.yaml`).

    Raises:
        NotPossible: no attitude to begin with.
    """
    begun = time.process_time()
    around = Surroundings(problem.environment)
    first = batch_start(problem, start, around)
    if one_camera.applies(problem, start):
        first, found, m = one_camera.fit_tracks(problem, first, start, around, model)
        rival = None
        if _turn_in_body(found.predicted.motion.w) < NEARLY_FLAT:
            found, rival = _rivals(problem, m, found, around, Belief())
        covariance = one_camera.clustered_covariance(problem, m, found, around)
        told = result(problem, first, found, around, time.process_time() - begun, rival, covariance)
        return replace(told, memory_counted=True)
    state, free = first.state, first.free
    if model is not None and model.modules:
        state = replace(state, model=model)
        free = np.concatenate([free, np.ones(state.size - 17, bool)])
    m = measurements_of(problem, observed=first.observed, channels=first.channels)
    belief = Belief()
    if prior.inertia is not None and prior.attitude:
        sigma = 0.05 if prior.k_sigma is None else float(np.max(prior.k_sigma))
        belief = Belief(3.0 * prior.inertia / np.trace(prior.inertia), max(sigma, 1e-6))
    found = fit(problem, m, state, around, free, belief)
    own = _state_of_model(state, model, problem)
    if own is not None:
        # the model's own state is near its minimum; the usual start need not lie in the same valley
        found = min(found, fit(problem, m, own, around, free, belief), key=_cost)
    rival = None
    if _turn_in_body(found.predicted.motion.w) < NEARLY_FLAT:
        found, rival = _rivals(problem, m, found, around, belief)
    told = result(problem, first, found, around, time.process_time() - begun, rival)
    if told.converged and told.observable:
        told = replace(told, residuals=residual_rows(problem, m, found), halves=halves(problem, m, found, around))
    return replace(told, cpu_us_per_step=1e6 * (time.process_time() - begun) / len(problem.times))


def _state_of_model(state: BatchState, model: Model | None, problem: Problem) -> BatchState | None:
    """The state in which `model.yaml` says that the record begins; None where it says nothing."""
    if model is None or model.rate is None or model.inertia is None:
        return None
    q0 = state.q0 if model.attitude is None or not problem.has_attitude else model.attitude
    inertia = physical(3.0 * model.inertia / np.trace(model.inertia))
    return replace(state, q0=q0, w0=model.rate, inertia=inertia)


def _cost(found: Fit) -> float:
    return found.cost if np.isfinite(found.cost) else np.inf


def _turn_in_body(w: np.ndarray) -> float:
    """Largest angle [rad] of the angular velocity in the body from its mean direction."""
    way = w / np.maximum(np.linalg.norm(w, axis=1, keepdims=True), 1e-300)
    mean = way.mean(axis=0)
    return float(np.arccos(np.clip(np.min(way @ mean) / max(float(np.linalg.norm(mean)), 1e-300), -1, 1)))


def _rivals(
    problem: Problem, m: Measurements, found: Fit, around: Surroundings, belief: Belief
) -> tuple[Fit, str | None]:
    """The best of fits that begin with other inertias, and what is said when one differs but explains as much.

    Near a flat spin the linear covariance holds at one answer and says nothing of the others.
    """
    moments, axes = np.linalg.eigh(found.state.inertia)
    along = int(np.argmax(np.abs(axes.T @ found.state.w0)))
    others = [i for i in range(3) if i != along]
    starts = [np.eye(3)]
    for place in range(3):
        new = np.empty(3)
        rest = np.delete(moments, place)
        new[along], new[others[0]], new[others[1]] = moments[place], rest[0], rest[1]
        starts.append((axes * new) @ axes.T)
    fits = [found]
    best = found
    for inertia in starts:
        other = fit(problem, m, replace(found.state, inertia=inertia), around, found.free, belief)
        if not np.isfinite(other.cost):
            continue
        fits.append(other)
        best = min(fits, key=lambda f: f.cost)
        k = ratio_slopes(best.state.inertia)[0]
        for f in fits:
            off = np.max(np.abs(ratio_slopes(f.state.inertia)[0] - k))
            if 2 * (f.cost - best.cost) < RIVAL_CHI2 and off > LARGEST_SIGMA_K:
                return best, "bodies of quite different inertia explain this motion as well: it is nearly a flat spin"
    return best, None


def result(
    problem: Problem,
    first: BatchStart,
    found: Fit,
    around: Surroundings,
    seconds: float,
    rival: str | None = None,
    covariance: np.ndarray | None = None,
) -> Estimate:
    """The fit as an `Estimate`, with the covariance (size, size) of its parameters where it is not the plain one."""
    state, motion = found.state, found.predicted.motion
    covariance = covariance_of(found) if covariance is None else covariance
    k, axes, slopes, turns = ratio_slopes(state.inertia)
    block = covariance[12:17, 12:17]
    k_covariance, axes_covariance = slopes @ block @ slopes.T, turns @ block @ turns.T
    hidden = rival or _unobservable(np.sqrt(np.diag(k_covariance)), axes_covariance, state.w0, axes)
    tracked = "tracks" in first.channels
    sigma = _sigmas(problem, found, around, covariance)
    cam = motion.turn
    placed = first.observed.any(axis=(0, 1)) if first.observed.size else np.zeros(len(problem.features), bool)
    return Estimate(
        name=NAME,
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
        q=multiply(from_rotation_matrix(cam), found.predicted.q) if around.lvlh else found.predicted.q,
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
    )


def _sigmas(
    problem: Problem, found: Fit, around: Surroundings, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """1-sigma (n, 3) of attitude, rates, position and velocity."""
    state = found.state
    turn, rate = sensitivities(
        problem.times,
        found.predicted.trajectory,
        state.q0,
        state.w0,
        state.inertia,
        inertia_directions(state.inertia),
        state.model.acting,
        state.model.flat(True),
        around,
    )
    nm = state.motion_count
    by_turn, by_path = np.r_[0:6, 12:17, 17 : 17 + nm], np.r_[6:12, 17 : 17 + nm]

    def spread(J: np.ndarray, rows: np.ndarray) -> np.ndarray:
        own = covariance[np.ix_(rows, rows)]
        return np.asarray(np.sqrt(np.maximum(np.einsum("nij,jk,nik->ni", J, own, J), 0.0)))

    at = found.predicted
    return spread(turn, by_turn), spread(rate, by_turn), spread(at.dr, by_path), spread(at.dv, by_path)


def _unfit(found: Fit) -> str:
    """Why the fit does not explain the data; empty when it does."""
    if not (found.converged and np.isfinite(found.cost)):
        return f"no rest after {found.iterations} iterations"
    misfit = found.chi2 / found.freedom
    if misfit > MISFIT:
        return f"residuals are {np.sqrt(misfit):.2g} times the stated noise: the model lacks something, try diagnose"
    return ""


def _unobservable(sigma: np.ndarray, axes_covariance: np.ndarray, w0: np.ndarray, axes: np.ndarray) -> str:
    """One line when the data do not show ratios or axes; empty when they do."""
    if not np.isfinite(sigma).all() or sigma.max() > LARGEST_SIGMA_K:
        along = np.abs(axes.T @ w0) / max(float(np.linalg.norm(w0)), 1e-300)
        off = float(np.degrees(np.arccos(min(1.0, float(along.max())))))
        return (
            f"the motion does not show the ratios (1-sigma of k1, k2: {sigma[0]:.2g}, {sigma[1]:.2g}): "
            f"it spins {off:.1f} deg from a principal axis, or is too short"
        )
    if np.sqrt(np.max(np.diag(axes_covariance))) > LARGEST_SIGMA_AXES:
        return "the body is symmetric as far as the motion shows: its principal axes are not determined"
    return ""
