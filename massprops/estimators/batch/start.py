"""Where the batch search begins: the first guess, carried over the whole record by attitude fits of growing span."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import project_to_physical
from massprops.dynamics.quaternion import from_rotation_matrix, multiply, nearest_rotation, rotation_matrix
from massprops.dynamics.rigid_body import propagate
from massprops.errors import NotPossible
from massprops.estimators.batch.solve import InertiaPrior, Search, fit
from massprops.estimators.start import Start
from massprops.model import Model
from massprops.model.linearise import Predicted, predict
from massprops.model.measurements import Measurements, measurements_of
from massprops.model.problem import Problem
from massprops.model.state import BODY_SIZE, INERTIA, BatchState

FIRST_TURNS = 1.0
"""Span of the first attitude fit, in revolutions."""
FEWEST_EPOCHS = 20
POOR = 1.5
"""Chi-square over freedom of the attitude fit beyond which another beginning is tried."""


@dataclass(frozen=True)
class BatchStart:
    """Where to begin and what may move.

    Attributes:
        state: the first state; free: (17,) parameters of motion and inertia that may move.
        channels: sensors used; body_frame: as `Estimate`.
        observed: (n, c, m) track observations of features that have a place.
        notes: what was left out.
    """

    state: BatchState
    free: np.ndarray
    channels: tuple[str, ...]
    body_frame: str
    observed: np.ndarray
    notes: tuple[str, ...] = ()


def batch_start(
    problem: Problem, start: Start, environment: EnvironmentModel, own_attitudes: bool = False
) -> BatchStart:
    """A first state for the whole record.

    Args:
        start: the first guess.
        own_attitudes: attitude0 is a sensor of its own, so that the tracks of one camera count beside it.

    Raises:
        NotPossible: no attitude to begin with.
    """
    notes: list[str] = []
    frame = start.body_frame
    q, w = multiply(chaser_path(problem.environment, start.times).q, start.q), start.w
    moments = np.eye(3) if start.inertia is None or not np.isfinite(start.inertia).all() else start.inertia
    features = start.features
    tracks = problem.has_tracks and start.position is not None and features is not None
    if frame == "own" and problem.has_rates and problem.has_tracks:
        turn = _gyroscope_frame(problem, start)
        q = multiply(q, from_rotation_matrix(turn.T)[None])
        w, moments = w @ turn.T, turn @ moments @ turn.T
        features = None if features is None else features @ turn.T
    moments = 3.0 * project_to_physical(moments)
    k = _first_steady(start.times, q, w, moments)
    q0, w0 = _back(problem.times[0], start.times[k:], q[k:], w[k:], moments)
    r0, v0 = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    if tracks:
        assert start.position is not None
        v0 = start.velocity if start.velocity is not None else np.zeros(3)
        r0 = start.position[0] - v0 * (start.times[0] - problem.times[0])
    m = len(problem.features)
    points = np.full((m, 3), np.nan) if features is None else np.array(features, float)
    state = BatchState(q0, w0, r0, v0, moments, Model(), points)
    state = _grow(problem, start, q, state, environment)
    channels = ("rates", "attitude") if problem.has_attitude else ("rates",)
    if tracks and (own_attitudes or problem.stereo or not problem.has_attitude):
        channels = ("range", *channels, "tracks")
    elif problem.has_tracks:
        notes.append("the attitude history of one camera's footage is used in place of the tracks it came from")
    observed = np.zeros_like(problem.seen)
    if "tracks" in channels:
        state, observed = place_points(problem, state, environment)
        lost = int((problem.seen.any(axis=(0, 1)) & ~observed.any(axis=(0, 1))).sum())
        if lost:
            notes.append(f"{lost} features could not be placed on the body and are left out")
        if not observed.any():
            raise NotPossible("no feature could be placed on the body: give longer tracks, or cameras further apart")
    return BatchStart(state, _free(problem, "tracks" in channels), channels, frame, observed, tuple(notes))


def _free(problem: Problem, tracked: bool) -> np.ndarray:
    """(17,) parameters of motion and inertia that the data can move."""
    free = np.ones(BODY_SIZE, bool)
    free[:3] = problem.has_attitude
    if not tracked:
        free[6:12] = False
    elif len(problem.cameras) == 1 and not problem.has_range:
        # one camera cannot tell size from distance: the distance stays
        free[8] = False
    return free


def _gyroscope_frame(problem: Problem, start: Start) -> np.ndarray:
    """(3, 3) from the start's own body axes to the gyroscope's: the turn that carries one's rates into the other's."""
    rows = np.searchsorted(problem.times, start.times)
    both = np.isfinite(problem.rates[rows]).all(axis=1)
    if both.sum() < 3:
        return np.eye(3)
    return nearest_rotation(problem.rates[rows[both]].T @ start.w[both])


def _turn(w: np.ndarray) -> float:
    """Time [s] of the revolutions that the first fit spans."""
    return FIRST_TURNS * 2 * np.pi / max(float(np.median(np.linalg.norm(w, axis=1))), 1e-12)


def _first_steady(times: np.ndarray, q: np.ndarray, w: np.ndarray, inertia: np.ndarray) -> int:
    """The first epoch whose angular momentum is as near as most to that of its neighbours in the first revolution: the
    rates at the ends of the record, and where features come and go, are the worst known."""
    rows = np.flatnonzero(times <= times[0] + _turn(w))
    momentum = np.einsum("kij,jl,kl->ki", rotation_matrix(q[rows]), inertia, w[rows])
    away = np.linalg.norm(momentum - np.median(momentum, axis=0), axis=1)
    return int(rows[np.argmax(away <= np.median(away))])


def _back(
    first: float, times: np.ndarray, q: np.ndarray, w: np.ndarray, inertia: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """State at the first epoch of all from the first of the guess."""
    if times[0] - first < 1e-9:
        return q[0], w[0]
    at, rate = propagate(q[0], w[0], inertia, np.array([times[0], first]))
    return at[-1], rate[-1]


def _grow(
    problem: Problem, start: Start, q: np.ndarray, state: BatchState, environment: EnvironmentModel
) -> BatchState:
    """Fits of the attitude history over spans that double until the whole record is covered."""
    n = len(problem.times)
    attitude, sigma = np.full((n, 4), np.nan), np.full(n, np.nan)
    rows = np.clip(np.searchsorted(problem.times, start.times - 1e-9), 0, n - 1)
    attitude[rows] = q
    spread = np.sqrt(np.einsum("nii->n", start.covariance[:, :3, :3]) / 3.0)
    spread = np.where(np.isfinite(spread) & (spread > 0), spread, np.nanmedian(spread))
    sigma[rows] = np.maximum(spread, 1e-7)
    still = replace(around_free(problem), attitude=attitude, sigma_attitude=sigma)
    free = np.zeros(BODY_SIZE, bool)
    free[:6] = free[INERTIA] = True
    fixed = EnvironmentModel(replace(problem.environment, chaser_attitude="inertial"), compiled=environment.compiled)
    span = max(_turn(start.w), problem.times[min(FEWEST_EPOCHS, n - 1)])
    whole = float(problem.times[-1])

    still_inertia = free.copy()
    still_inertia[INERTIA] = False

    def grown(inertia: np.ndarray, w0: np.ndarray, free: np.ndarray = free) -> tuple[BatchState, float]:
        return _doubled(
            still, replace(state, inertia=inertia, w0=w0, points=np.zeros((0, 3))), fixed, free, span, whole
        )

    best, chi2 = grown(state.inertia, state.w0)
    if not chi2 < POOR:
        # a short span can lose the inertia that the whole record gave the guess
        held, _ = grown(state.inertia, state.w0, still_inertia)
        other, other_chi2 = _doubled(still, held, fixed, free, whole, whole)
        if not chi2 <= other_chi2:
            best, chi2 = other, other_chi2
    if not chi2 < POOR:
        # a flat spin or a ball gives a guess that means nothing: no preference is the better beginning
        other, other_chi2 = grown(np.eye(3), np.median(start.w, axis=0))
        if not chi2 <= other_chi2:
            best = other
    return replace(state, q0=best.q0, w0=best.w0, inertia=best.inertia)


def _doubled(
    still: Problem, blank: BatchState, fixed: EnvironmentModel, free: np.ndarray, span: float, whole: float
) -> tuple[BatchState, float]:
    """The state after fits of doubling span, and chi-squared of the last over its freedom."""
    chi2 = np.inf
    while True:
        inside = still.times <= span
        m = measurements_of(still, inside, channels=("attitude",))
        if len(m.attitude_at) >= 6:
            last = int(np.flatnonzero(inside)[-1]) + 1
            fitted = fit(
                still.of_epochs(itemgetter(slice(last))), m, blank, fixed, free, InertiaPrior(weak=1.0), Search(most=25)
            )
            blank, chi2 = fitted.state, fitted.chi2 / fitted.freedom
        if span >= whole:
            return blank, chi2
        span *= 2.0


def around_free(problem: Problem) -> Problem:
    """The problem without its tracks: attitudes alone need none of them."""
    return replace(problem, uv=np.zeros((len(problem.times), 0, 0, 2)), features=np.zeros(0, int), cameras=())


def place_points(
    problem: Problem, state: BatchState, environment: EnvironmentModel, observed: np.ndarray | None = None
) -> tuple[BatchState, np.ndarray]:
    """Feature points by linear triangulation over all epochs at the state's motion, where the state has none.

    Returns:
        the state with points, and which observations (n, c, m) belong to placed features.
    """
    m = measurements_of(problem, observed=observed, channels=("tracks",))
    at = predict(problem, state, environment)
    rays, where = _ray_rows(problem, at, m)
    points = state.points.copy()
    usable = problem.seen if observed is None else problem.seen & observed
    for j in np.flatnonzero(~np.isfinite(points).all(axis=1)):
        of_feature = m.seen.feature == j
        if of_feature.sum() < 2:
            continue
        A, b = rays[of_feature].reshape(-1, 3), where[of_feature].reshape(-1)
        values = np.linalg.eigvalsh(A.T @ A)
        if values[0] < 1e-8 * values[-1]:
            continue
        points[j] = np.linalg.lstsq(A, b, rcond=None)[0]
    placed = np.isfinite(points).all(axis=1)
    return replace(state, points=np.where(placed[:, None], points, 0.0)), usable & placed[None, None, :]


def _ray_rows(problem: Problem, at: Predicted, m: Measurements) -> tuple[np.ndarray, np.ndarray]:
    """(o, 2, 3) and (o, 2): a body point P lies on its ray where rows P = right-hand side."""
    rows, right = np.zeros((len(m.uv), 2, 3)), np.zeros((len(m.uv), 2))
    e = m.seen.epoch
    turn = at.motion.attitude[e]
    place = np.einsum("oij,oj->oi", at.motion.turn[e], at.motion.r[e])
    for k, camera in enumerate(problem.cameras):
        of_camera = m.seen.camera == k
        fu, fv, cu, cv = camera.intrinsics
        x = (m.uv[of_camera, 0] - cu) / fu
        y = (m.uv[of_camera, 1] - cv) / fv
        for row, (axis, value) in enumerate(((0, x), (1, y))):
            normal = camera.R[axis] - value[:, None] * camera.R[2]
            rows[of_camera, row] = np.einsum("oi,oij->oj", normal, turn[of_camera])
            right[of_camera, row] = -np.sum(normal * (place[of_camera] - camera.t), axis=1)
    return rows, right
