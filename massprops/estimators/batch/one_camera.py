"""The smoother on one camera's tracks, as structure from motion leaves them: attitudes to begin with, pixels to fit.

The attitudes of structure from motion come from the same pixels, so only the pixels count. Their errors are shared:
features near each other on the body slide alike under one Sun, all features of neighbouring frames are matched alike, and
whatever passes the same side of the camera, the limb or the terminator, slides the same way there all the time. So the
covariance is a sandwich with clusters in three ways, places on the body, blocks of time and places before the camera (Huber
1967; Liang and Zeger 1986, eq. 5; Cameron, Gelbach and Miller 2011, eq. 2.10), each cluster judged without itself. Focal length and radial distortion were found from the same images: both are free again,
since a body that turns freely tells them apart from its shape.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import nearest_rotation, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators.batch.solve import Fit, fit
from massprops.estimators.batch.start import BatchStart, place_points
from massprops.model import Model, model_of
from massprops.model.linearise import linearise
from massprops.model.measurements import Measurements, measurements_of
from massprops.model.problem import Problem
from massprops.model.state import BatchState, in_axes

LENS = ("focal-length-error", "lens-distortion")
"""What a camera without calibration leaves open."""
FEWEST_FEATURES = 20
PLACES = 30
"""Clusters of features on the body."""
FEWEST_BLOCKS, MOST_BLOCKS = 6, 12
"""Blocks of time: as many as leave each twice as long as nearly all tracks, since what one track hands on to the next is alike in
both."""
SIDES = 6
"""Clusters of where the body's surface is before the camera. In four films of asteroids with truth the squared errors of k1 and
k2 over their covariance were 11.8, 7.5, 6.1 and 1.0 times what they should be with 12 blocks of 4 images and 30 places, each with
itself in the fit; 4.9, 3.7, 2.5 and 0.6 with each left out and 12 sides beside them; 1.7, 1.4, 2.9 and 0.3 with 6 sides and 6 blocks
of nine images, where nine tracks in ten are of seven images or fewer."""
LEAST_LEFT = 0.02
"""Share of the information on a combination of numbers that counts as left where a cluster holds all of it."""


def applies(problem: Problem, start: Any) -> bool:
    """Whether the sequence is one camera's tracks with attitudes from the same images."""
    return bool(
        problem.has_attitude
        and problem.has_tracks
        and not problem.stereo
        and start.position is not None
        and start.features is not None
        and len(problem.features) >= FEWEST_FEATURES
    )


def fit_tracks(
    problem: Problem, first: BatchStart, start: Any, environment: EnvironmentModel, model: Model | None = None
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
    # the body frame is the first attitude's, and the distance is free of any scale
    free[:3] = False
    free[8] = problem.has_range
    channels = ("tracks", "range") if problem.has_range else ("tracks",)
    m = replace(measurements_of(problem, observed=observed, channels=channels), may_slide=True)
    found = fit(problem, m, state, environment, free)
    found = fit(problem, m, _in_axes_of_attitudes(problem, found, environment), environment, free)
    begun = replace(first, state=state, free=free, channels=channels, observed=observed, notes=())
    return begun, found, m


def _in_axes_of_attitudes(problem: Problem, found: Fit, environment: EnvironmentModel) -> BatchState:
    """The state with its body axes turned onto those of attitude0, as the mean over all epochs has it."""
    state, rows = found.state, np.flatnonzero(np.isfinite(problem.attitude).all(axis=1))
    seen = rotation_matrix(found.predicted.q[rows])
    if environment.lvlh:
        seen = found.predicted.motion.turn[rows] @ seen
    turns = np.swapaxes(rotation_matrix(problem.attitude[rows]), 1, 2) @ seen
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
    seen = _Seen(score, np.sqrt(w)[..., None] * slope, (vectors / np.sqrt(np.maximum(values, 1e-12))).T / scale)
    middle = _in_all_ways(seen, _alike(problem, m, found, environment))
    plain = inverse * max(1.0, found.chi2 / found.freedom)
    # the difference of the two ways need not be a covariance: no direction may fall below independent errors
    root = np.linalg.cholesky(plain + 1e-300 * np.eye(len(plain)))
    relative = np.linalg.solve(root, np.linalg.solve(root, inverse @ middle @ inverse).T)
    grown, ways = np.linalg.eigh(0.5 * (relative + relative.T))
    own = root @ (ways * np.maximum(grown, 1.0)) @ ways.T @ root.T
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = own
    return out


def _alike(problem: Problem, m: Measurements, found: Fit, environment: EnvironmentModel) -> tuple[np.ndarray, ...]:
    """Labels (o,) of observations whose errors may be alike: by place on the body, by time, and by where the surface is before
    the camera."""
    from scipy.cluster.vq import kmeans2

    who, at = np.unique(m.seen.feature, return_inverse=True)
    places = found.state.points[who]
    count = max(2, min(PLACES, len(who) // 3))
    place = kmeans2(places / (places.std() or 1.0), count, seed=1, minit="++")[1][at]
    epochs = len(problem.times)
    long = float(np.quantile(np.bincount(at), 0.9))
    block = m.seen.epoch * int(np.clip(epochs / (2 * long), FEWEST_BLOCKS, MOST_BLOCKS)) // epochs
    turn = rotation_matrix(found.predicted.q)
    if environment.lvlh:
        turn = found.predicted.motion.turn @ turn
    before = np.einsum("oij,oj->oi", turn[m.seen.epoch], places[at])
    side = kmeans2(before / (before.std() or 1.0), SIDES, seed=1, minit="++")[1]
    return place, block, side


class _Seen(NamedTuple):
    """Of o observations the score (o, f) and the weighed derivatives (o, 2, f), points eliminated, and a root of the inverse
    information: root^T root, root (f, f)."""

    score: np.ndarray
    slope: np.ndarray
    root: np.ndarray


def _in_all_ways(seen: _Seen, labels: tuple[np.ndarray, ...]) -> np.ndarray:
    """(f, f) of errors alike in any of several ways: sums over clusters of each, less those of pairs, and so on."""
    total = np.zeros((seen.score.shape[1],) * 2)
    for count in range(1, len(labels) + 1):
        for some in combinations(labels, count):
            total -= (-1) ** count * _summed(seen, np.unique(np.stack(some), axis=1, return_inverse=True)[1].ravel())
    return total


def _summed(seen: _Seen, label: np.ndarray) -> np.ndarray:
    """(f, f) sum over clusters (o,) of the squared sums of their scores.

    The fit bends to a cluster that decides it, such as the first or the last block of a record, and leaves it small
    residuals. So a score counts as it would without its cluster in the fit: the jackknife (Bell and McCaffrey 2002, CR3).
    """
    total = np.zeros((seen.score.shape[1],) * 2)
    for one in np.unique(label):
        own = label == one
        slope = seen.slope[own].reshape(-1, total.shape[0]) @ seen.root.T
        share, ways = np.linalg.eigh(slope.T @ slope)
        # in units of the whole information: what is left without the cluster
        left = 1.0 / np.clip(1.0 - share, LEAST_LEFT, 1.0)
        unit = seen.root @ seen.score[own].sum(axis=0)
        moved = np.linalg.solve(seen.root, ways @ (left * (ways.T @ unit)))
        total += np.outer(moved, moved)
    count = len(np.unique(label))
    return total * (count - 1) / count
