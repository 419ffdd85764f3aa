"""The smoother on tracks as structure from motion leaves them: attitudes to begin with, pixels to fit.

The attitudes of structure from motion come from the same pixels, so only the pixels count. Their errors are shared. Features
near each other on the body slide alike under one Sun. All features of neighbouring frames are matched alike. Whatever passes the
limb or the terminator slides the same way there all the time. So the covariance is a sandwich with clusters in three ways: places
on the body, blocks of time, places before the camera (Huber 1967; Liang and Zeger 1986, eq. 5; Cameron, Gelbach and Miller 2011,
eq. 2.10). Each cluster is judged without itself. Focal length and radial distortion were found from the same images: both are free
again, since a body that turns freely tells them apart from its shape.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.core.clustered import SIDES, Scores, in_blocks, in_places, multiway_meat
from massprops.core.linalg import at_least
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import nearest_rotation, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators.batch.solve import Fit, fit
from massprops.estimators.batch.start import BatchStart, place_points
from massprops.estimators.start import Start
from massprops.model import Model, model_of
from massprops.model.linearise import linearise
from massprops.model.measurements import Measurements, measurements_of
from massprops.model.problem import Problem
from massprops.model.state import BatchState, in_axes

LENS = ("focal-length-error", "lens-distortion")
"""What a camera without calibration leaves open."""
FEWEST_FEATURES = 20
"""Features from which cameras alone show the motion."""


def applies(problem: Problem, start: Start) -> bool:
    """Whether the sequence is tracks with attitudes from the same images; those of one camera always are."""
    return bool(
        problem.has_attitude
        and problem.has_tracks
        and not (problem.stereo and problem.own_attitudes)
        and start.position is not None
        and start.features is not None
        and len(problem.features) >= FEWEST_FEATURES
    )


def fit_tracks(
    problem: Problem, first: BatchStart, start: Start, environment: EnvironmentModel, model: Model | None = None
) -> tuple[BatchStart, Fit, Measurements]:
    """The fit of all pixels, in the body axes of `attitude0`.

    Args:
        first: the start that was fitted to the attitudes. start: of `first_guess`, with path and features.
        model: effects that the user named.

    Returns:
        the start with its channels, the fit, and the measurements fitted.

    Raises:
        NotPossible: too few features could be placed.
    """
    assert start.position is not None
    state = replace(
        first.state,
        r0=np.array(start.position[0], float),
        v0=np.array(start.velocity if start.velocity is not None else np.zeros(3), float),
        points=np.array(start.features, float),
    )
    state, observed = place_points(problem, state, environment)
    if observed.any(axis=(0, 1)).sum() < FEWEST_FEATURES:
        raise NotPossible(f"fewer than {FEWEST_FEATURES} features could be placed on the body: give longer tracks")
    known = {} if model is None else dict(zip(model.names, model.values, strict=True))
    state = replace(state, model=model_of({**known, **{name: None for name in LENS if name not in known}}))
    free = np.ones(state.size, bool)
    # the body frame is the first attitude's, and one camera's distance is free of any scale
    free[:3] = False
    free[8] = problem.has_range or problem.stereo
    channels = ("tracks", "range") if problem.has_range else ("tracks",)
    m = replace(measurements_of(problem, observed=observed, channels=channels), may_slide=True)
    fitted = fit(problem, m, state, environment, free)
    fitted = fit(problem, m, _in_axes_of_attitudes(problem, fitted), environment, free)
    begun = replace(first, state=state, free=free, channels=channels, observed=observed, notes=())
    return begun, fitted, m


def _in_axes_of_attitudes(problem: Problem, found: Fit) -> BatchState:
    """The state with its body axes turned onto those of attitude0, as the mean over all epochs has it."""
    state, rows = found.state, np.flatnonzero(np.isfinite(problem.attitude).all(axis=1))
    turns = np.swapaxes(rotation_matrix(problem.attitude[rows]), 1, 2) @ found.predicted.motion.attitude[rows]
    return in_axes(state, nearest_rotation(turns.sum(axis=0)))


def clustered_covariance(problem: Problem, m: Measurements, found: Fit, environment: EnvironmentModel) -> np.ndarray:
    """(size, size) sandwich with clusters of place, of time and of the camera's side, zero for what is held; never below
    the independent errors'."""
    linear = linearise(problem, m, found.predicted, environment)
    o, free = len(m.uv), found.free
    w = found.weights[:o, None]
    J = linear.shared[: 2 * o].reshape(o, 2, -1)[:, :, free]
    F, r = linear.point, linear.residuals.tracks
    who, at = np.unique(m.seen.feature, return_inverse=True)
    V, W = np.zeros((len(who), 3, 3)), np.zeros((len(who), int(free.sum()), 3))
    np.add.at(V, at, np.einsum("oki,okj->oij", F * w[..., None], F))
    np.add.at(W, at, np.einsum("okp,oki->opi", J * w[..., None], F))
    V += 1e-9 * np.trace(V, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-12 * np.eye(3)
    back = W @ np.linalg.inv(V)
    # each observation's part of the score, with its own feature point eliminated
    slope = J - np.einsum("oki,opi->okp", F, back[at])
    score = w * np.einsum("okp,ok->op", slope, r)
    scale = np.sqrt(np.maximum(np.diag(found.information), 1e-300))
    values, vectors = np.linalg.eigh(found.information / scale[:, None] / scale)
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T / scale[:, None] / scale
    seen = Scores(score, np.sqrt(w)[..., None] * slope, (vectors / np.sqrt(np.maximum(values, 1e-12))).T / scale)
    middle = multiway_meat(seen, _alike(problem, m, found))
    plain = inverse * max(1.0, found.chi2 / found.freedom)
    # sums and differences need not be a covariance: no direction may fall below independent errors
    free_covariance = at_least(plain, inverse @ middle @ inverse)
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = free_covariance
    return out


def _alike(problem: Problem, m: Measurements, found: Fit) -> tuple[np.ndarray, ...]:
    """Labels (o,) of observations whose errors may be alike: by place on the body, by time, and by where the surface is before
    the camera."""
    who, at = np.unique(m.seen.feature, return_inverse=True)
    places = found.state.points[who]
    before = np.einsum("oij,oj->oi", found.predicted.motion.attitude[m.seen.epoch], places[at])
    return in_places(places)[at], in_blocks(m.seen.epoch, len(problem.times), at), in_places(before, SIDES)
