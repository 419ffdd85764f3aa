"""The motion's side of the cross-check: an estimate's inertia in the mesh's axes, and the point that the body turns about."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.consistency.jackknife import replicates, spread
from massprops.consistency.mesh_side import MeshSide
from massprops.core.linalg import at_least
from massprops.core.robust import MAD_TO_SIGMA
from massprops.dynamics.alignment import similarity
from massprops.dynamics.quaternion import angle_between, nearest_rotation, rotation_matrix
from massprops.estimators.result import Estimate
from massprops.mass.ratio_space import covariance, log_components
from massprops.model.problem import Problem
from massprops.sequence.data import Sequence
from massprops.sfm.points import SparsePoints
from massprops.views import Views

CENTRE_FLOOR = 1e-3
"""Share of the body's length to which structure from motion, bent a little by its own lens, places any point."""
LEAST_COMMON = 3
"""Common epochs of two attitude histories that tie their body frames."""


@dataclass(frozen=True)
class Frame:
    """The run's own attitude history and features: what ties an estimator's body axes to the mesh's.

    Attributes:
        stamp_ns: (n,); q: (n, 4) mesh axes to cam0; sigma: (n,) [rad].
        feature_ids: (m,) and features: (m, 3) in the mesh's axes, or None.
    """

    stamp_ns: np.ndarray
    q: np.ndarray
    sigma: np.ndarray
    feature_ids: np.ndarray | None = None
    features: np.ndarray | None = None


def to_mesh_axes(
    estimate: Estimate, problem: Problem, frame: Frame, same_footage: bool
) -> tuple[np.ndarray, str] | None:
    """Rotation (3, 3) from the estimate's body axes to the mesh's, and by what; None when nothing ties them.

    Args:
        estimate: of one method; problem: what it was made from.
        frame: the run's own.
        same_footage: whether the problem is the run's own sequence, so that its attitude0 is the mesh's frame.
    """
    if estimate.body_frame == "attitude0" and same_footage:
        return np.eye(3), "attitude0"
    if estimate.q is not None and len(frame.stamp_ns):
        stamps = problem.stamps(estimate.times)
        _, at, there = np.intersect1d(stamps, frame.stamp_ns, return_indices=True)
        good = np.isfinite(estimate.q[at]).all(axis=1)
        at, there = at[good], there[good]
        late = slice(len(at) // 2, None)
        if len(at[late]) >= LEAST_COMMON:
            R = np.swapaxes(rotation_matrix(frame.q[there[late]]), 1, 2) @ rotation_matrix(estimate.q[at[late]])
            mean = R.mean(axis=0)
            # rotations that do not agree average to less than a rotation: two clocks, or two bodies
            if np.linalg.svd(mean, compute_uv=False)[1] > 0.99:
                return nearest_rotation(mean), "attitude"
    common = _common_features(estimate, frame)
    return None if common is None else (common[1], "features")


def _common_features(estimate: Estimate, frame: Frame) -> tuple[float, np.ndarray] | None:
    """Scale and rotation (3, 3) from the estimate to the mesh by features of both; None with fewer than four."""
    if estimate.features is None or frame.features is None or frame.feature_ids is None or estimate.feature_ids is None:
        return None
    _, a, b = np.intersect1d(estimate.feature_ids, frame.feature_ids, return_indices=True)
    good = np.isfinite(estimate.features[a]).all(axis=1)
    found_similarity = similarity(estimate.features[a[good]], frame.features[b[good]]) if good.sum() >= 4 else None
    return None if found_similarity is None else found_similarity[:2]


def scale_against(estimate: Estimate, frame: Frame) -> float | None:
    """Lengths of the mesh over those of the estimate, from common features; None without any."""
    common = _common_features(estimate, frame)
    return None if common is None else common[0]


def motion_covariance(
    estimate: Estimate, turn: np.ndarray, axes: np.ndarray, alike: np.ndarray | None = None
) -> np.ndarray:
    """(5, 5) of the estimate's `log_components` in the mesh's principal `axes`; residuals above their noise widen it,
    and so does what one part of the surface says against the others.

    Args:
        turn: (3, 3) estimate's body axes to the mesh's. alike: (5, 5) `Slides.inertia`.
    """
    assert estimate.inertia is not None and estimate.k_covariance is not None
    inertia = turn @ estimate.inertia @ turn.T
    turns = None if estimate.axes_covariance is None else turn @ estimate.axes_covariance @ turn.T
    widened: np.ndarray = covariance(inertia, estimate.k_covariance, turns, axes) * max(1.0, estimate.innovation or 1.0)
    return widened if alike is None or turns is None else at_least(widened, alike)


@dataclass(frozen=True)
class Slides:
    """Errors that features of one region share: see `jackknife`.

    Attributes:
        centre: (3, 3) of the point that the body turns about, mesh axes and units.
        inertia: (5, 5) of the motion's `log_components` in the mesh's principal axes; None where no free motion fits.
    """

    centre: np.ndarray
    inertia: np.ndarray | None


def slides_of(views: Views, points: SparsePoints, stamp_ns: np.ndarray, sigma: np.ndarray, mesh: MeshSide) -> Slides:
    """How much the motion's results depend on single regions of the surface.

    Args:
        views: n images of cam0 in the order of time; points: what they saw.
        stamp_ns: (n,); sigma: (n,) of each attitude [rad].
    """
    from massprops.dynamics.quaternion import from_rotation_matrix
    from massprops.estimators.free_fit import fit_attitudes

    times = (stamp_ns - stamp_ns[0]) * 1e-9
    whole = fit_attitudes(times, from_rotation_matrix(views.R), sigma)
    centres, numbers = [], []
    for without in replicates(views, points):
        centre = centre_of_motion(stamp_ns, without.R, without.t * mesh.factor, mesh.length)
        if centre is not None:
            centres.append(centre.place)
        moved = None if whole is None else fit_attitudes(times, from_rotation_matrix(without.R), sigma, whole)
        if moved is not None:
            numbers.append(log_components(moved[2], mesh.axes))
    return Slides(
        spread(np.array(centres)) if len(centres) > 1 else np.zeros((3, 3)),
        spread(np.array(numbers)) if len(numbers) > 1 else None,
    )


@dataclass(frozen=True)
class Centre:
    """The point that the body turns about while it moves straight.

    Attributes:
        place: (3,) in the mesh's axes and units; covariance: (3, 3).
    """

    place: np.ndarray
    covariance: np.ndarray


def centre_of_motion(stamp_ns: np.ndarray, R: np.ndarray, t: np.ndarray, size: float = 0.0) -> Centre | None:
    """The body point whose path is straight and even: t_i + R_i c = p + v s_i, by weighted least squares.

    Depth is far less certain than the other two directions, and errors of neighbouring views are alike: each
    direction's weight is from its own residuals, and the covariance grows by their correlation (AR(1)).

    Args:
        stamp_ns: (n,); R: (n, 3, 3) body to camera; t: (n, 3) body origin in the camera.
        size: length of the body, of which `CENTRE_FLOOR` is added to the sigma.

    Returns:
        None with fewer than eight views, or a spin that leaves a direction of c free.
    """
    n = len(stamp_ns)
    if n < 8:
        return None
    s = (stamp_ns - stamp_ns[0]) / max(float(stamp_ns[-1] - stamp_ns[0]), 1.0)
    A = np.concatenate([R, np.broadcast_to(-np.eye(3), (n, 3, 3)), -s[:, None, None] * np.eye(3)[None]], axis=2)
    weight = np.ones((n, 3))
    for _ in range(6):
        J = (A * np.sqrt(weight)[..., None]).reshape(-1, 9)
        b = (-t * np.sqrt(weight)).ravel()
        x, _, rank, singular = np.linalg.lstsq(J, b, rcond=None)
        if rank < 9 or singular[-1] < 1e-4 * singular[0]:
            return None
        residual = t + np.einsum("nij,j->ni", A, x)
        scatter = MAD_TO_SIGMA * np.median(np.abs(residual), axis=0) + 1e-12 * np.linalg.norm(t, axis=1).mean()
        weight = 1.0 / (scatter**2 * (1.0 + (residual / (3.0 * scatter)) ** 2))
    floor = (CENTRE_FLOOR * size) ** 2
    alike = np.array([_ar1(residual[:, j]) for j in range(3)])
    growth = float(np.max((1 + alike) / (1 - alike)))
    J = (A * np.sqrt(weight)[..., None]).reshape(-1, 9)
    known = np.linalg.inv(J.T @ J) * growth * 3 * n / (3 * n - 9)
    return Centre(x[:3], known[:3, :3] + floor * np.eye(3))


def _ar1(x: np.ndarray) -> float:
    """Correlation of neighbours, kept within what a short series can tell."""
    x = np.clip(x, *np.quantile(x, [0.02, 0.98]))
    return float(np.clip(np.corrcoef(x[:-1], x[1:])[0, 1] if x.std() > 0 else 0.0, 0.0, 0.9))


@dataclass(frozen=True)
class Tumble:
    """How the attitude moved. turned: whole angle [rad]; wander: rms angle of the rate's direction in the body about
    its mean [rad]; noise: what the attitudes' own noise would give for that [rad]."""

    turned: float
    wander: float
    noise: float


def tumble_of(stamp_ns: np.ndarray, q: np.ndarray, sigma: np.ndarray) -> Tumble | None:
    """The tumbling of an attitude history (n, 4); None with fewer than four epochs.

    Rates are over chords long enough to turn by about 20 degrees, so that noise counts little.
    """
    n = len(stamp_ns)
    if n < 4:
        return None
    from massprops.dynamics.quaternion import conjugate, multiply, rotation_vector

    turned = np.concatenate([[0.0], np.cumsum(angle_between(q[1:], q[:-1]))])
    step = int(np.clip(np.searchsorted(turned, np.radians(20.0)), 1, n // 2))
    chord = rotation_vector(multiply(conjugate(q[:-step]), q[step:]))
    length = np.linalg.norm(chord, axis=1)
    good = length > 1e-9
    if good.sum() < 2:
        return Tumble(float(turned[-1]), 0.0, np.inf)
    mean = chord[good].mean(axis=0)
    size = float(np.linalg.norm(mean))
    if size < 1e-9:
        return Tumble(float(turned[-1]), np.pi / 2, float(np.median(sigma)))
    off = np.arctan2(np.linalg.norm(np.cross(chord[good], mean), axis=1), chord[good] @ mean)
    noise = 2.0 * float(np.sqrt(np.mean(sigma**2))) / float(np.median(length[good]))
    return Tumble(float(turned[-1]), float(np.sqrt(np.mean(off**2))), noise)


def frame_of(run: Path, sequence: Sequence) -> Frame:
    """The attitude history of a run's own sequence, empty when the object was still, and the run's sparse points."""
    from massprops.exchange.formats.filter import sparse_points

    attitude = sequence.attitude
    points = sparse_points(run)
    ids, xyz = points if points is not None else (None, None)
    if attitude is None:
        return Frame(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0), ids, xyz)
    return Frame(attitude.timestamp_ns, attitude.q, attitude.sigma, ids, xyz)
