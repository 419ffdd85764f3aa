"""From a problem and a first guess to the state that the EKF and the iterated EKF begin with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.dynamics.inertia import DIRECTIONS, cholesky_parameters, cholesky_ratio_derivatives, principal_axes
from massprops.dynamics.quaternion import from_rotation_matrix, multiply, rotate, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators.attitude_information import ratio_directions
from massprops.estimators.extended.error_state import Layout, State, covariance_of, state_of
from massprops.estimators.extended.transition import ProcessNoise
from massprops.estimators.filters.begin import (
    WIDER,
    WIDEST_K,
    early_start,
    noise_densities,
    point_sigma,
    settled_epoch,
    speed_of,
)
from massprops.estimators.inertia_parameters import GENERAL
from massprops.estimators.result import Prior
from massprops.estimators.surroundings import Surroundings, surroundings_of
from massprops.model.problem import Problem

CENTRE_SHARE = 0.3
"""1-sigma of the centre of mass at the start, as a share of the features' spread."""
SLOTS = 16
"""Features carried at a time."""
ATTITUDE_SHARE = {True: 0.1, False: 0.5}
"""By stereo or not: how much of the evidence attitude0 is given where tracks are used as well. Both come from the same
images, with a correlation that nobody states; covariance intersection with these weights never claims too much."""


@dataclass(frozen=True)
class Setup:
    """A filter ready to run over epochs `first` and later.

    Attributes:
        layout, state, P: before the measurements of epoch `first`; one run.
        slots: (SLOTS,) the problem's feature in each slot, -1 where none yet.
        size: spread of the features [m]. share: (tracks, attitude) weights of the evidence, 0 where not used.
        rates, ranges: whether imu0 and range0 are used.
        k_sigma: 1-sigma of k1, k2 to start with. largest_rate [rad/s] for the integration steps.
    """

    layout: Layout
    state: State
    P: np.ndarray
    slots: np.ndarray
    first: int
    size: float
    share: tuple[float, float]
    rates: bool
    ranges: bool
    k_sigma: float
    noise: ProcessNoise
    surroundings: Surroundings
    largest_rate: float
    body_frame: str
    scaled: bool
    warnings: tuple[str, ...] = ()

    @property
    def points(self) -> bool:
        return self.share[0] > 0


def setup(problem: Problem, prior: Prior, given: Any) -> Setup:
    """State and covariance from the first part of the data.

    Raises:
        NotPossible: no rotation or no inertia in the first guess.
    """
    start = early_start(problem, prior, given)
    inertia, spread = _inertia(prior, start, WIDER * problem.alike)
    if inertia is None or not len(start.q):
        raise NotPossible("the first guess found no rotation or no inertia to start from")
    row = settled_epoch(start)
    first = int(np.searchsorted(problem.times, start.times[row] - 1e-9))
    around = surroundings_of(problem.environment)
    C, _ = around.camera_frame(float(start.times[row]))
    q = multiply(from_rotation_matrix(C), start.q[row])[None]
    body = _body(problem, start, row, first, C)
    layout = Layout(len(body.slots), GENERAL)
    state = state_of(
        body.position[None],
        body.velocity[None],
        start.w[row][None],
        q,
        body.features[None],
        cholesky_parameters(inertia)[None],
    )
    doubt = start.covariance[row] * (WIDER * problem.alike) ** 2
    length = max(float(start.times[-1] - start.times[0]), 1e-9)
    centre = CENTRE_SHARE * body.size if body.points else 1.0
    place = np.array([body.fine**2 if slot >= 0 else 4 * body.size**2 for slot in body.slots])
    R = rotation_matrix(q)
    P = covariance_of(
        layout,
        state,
        centre**2 * np.eye(3),
        ((10 * body.fine / length) ** 2 + (speed_of(start) * centre) ** 2) * np.eye(3),
        R @ (doubt[3:, 3:] + 1e-18 * np.eye(3)) @ np.swapaxes(R, -1, -2),
        doubt[:3, :3] + 1e-12 * np.eye(3),
        spread,
        (place[:, None, None] + (centre**2 if body.points else 0.0)) * np.eye(3),
    )
    own = start.body_frame == "own"
    return Setup(
        layout=layout,
        state=state,
        P=P,
        slots=body.slots,
        first=first,
        size=body.size,
        share=_share(problem, body.points, own),
        # imu0 and the tracks need not share body axes
        rates=problem.has_rates and not body.points and (problem.has_attitude or own),
        ranges=body.points and problem.has_range,
        k_sigma=_k_sigma(inertia, spread),
        noise=ProcessNoise(*noise_densities(problem, prior, start), 1e-9),
        surroundings=around,
        largest_rate=2.0 * float(np.nanmax(np.linalg.norm(start.w, axis=1))),
        body_frame=start.body_frame,
        scaled=bool(start.scaled),
        warnings=tuple(start.warnings),
    )


@dataclass(frozen=True)
class _Body:
    """Whether features are tracked; which are in the slots (m,) and where, body axes (m, 3), their spread and the 1-sigma
    of one's place [m]; the centre of mass and its velocity, inertial axes from the chaser (3,)."""

    points: bool
    slots: np.ndarray
    features: np.ndarray
    size: float
    fine: float
    position: np.ndarray
    velocity: np.ndarray


def _body(problem: Problem, start: Any, row: int, first: int, C: np.ndarray) -> _Body:
    """What the filter carries besides rotation; C: (3, 3) cam0 axes into inertial ones."""
    if not (problem.has_tracks and start.features is not None and start.position is not None):
        return _Body(False, np.zeros(0, int), np.zeros((0, 3)), 0.0, 1.0, np.zeros(3), np.zeros(3))
    known = np.flatnonzero(np.isfinite(start.features[:, 0]))
    away = start.features[known] - start.features[known].mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    slots = _first_slots(problem, known, first)
    features = np.where((slots >= 0)[:, None], start.features[slots], 0.0)
    velocity = np.zeros(3) if start.velocity is None else C @ start.velocity
    return _Body(True, slots, features, size, _fine(problem, start, row), C @ start.position[row], velocity)


def _share(problem: Problem, points: bool, own: bool) -> tuple[float, float]:
    """Weights of the evidence of tracks and attitude0, 0 where not used."""
    if not points:
        return 0.0, 1.0 if problem.has_attitude else 0.0
    weight = ATTITUDE_SHARE[problem.stereo] if problem.has_attitude and not own else 0.0
    return 1.0 - weight, weight


def _inertia(prior: Prior, start: Any, wider: float) -> tuple[np.ndarray | None, np.ndarray]:
    """Inertia (3, 3) in the start's body axes, and the covariance (5, 5) of its parameters."""
    tensor = start.inertia
    if prior.inertia is not None:
        same = prior.attitude
        k = np.full(2, WIDEST_K) if prior.k_sigma is None else np.minimum(prior.k_sigma, 1.0)
        axes = np.full(3, WIDEST_K) if prior.axes_sigma is None else np.minimum(prior.axes_sigma, WIDEST_K)
        if same or tensor is not None:
            moments, frame = principal_axes(prior.inertia)
            if not same:
                # other body axes: the prior's ratios on the axes that the motion shows
                frame, axes = principal_axes(tensor)[1], np.full(3, WIDEST_K)
            tensor = frame @ np.diag(moments / moments.sum()) @ frame.T
            J = _by_parameters(tensor, ratio_directions(moments / moments.sum(), frame))
            return tensor, J @ np.diag(np.concatenate([k, axes]) ** 2) @ J.T + 1e-6 * np.eye(GENERAL)
    if tensor is None:
        return None, np.eye(GENERAL)
    J = _by_parameters(tensor, DIRECTIONS)
    widest = WIDEST_K**2 * np.eye(GENERAL)
    if start.momentum is None:
        return tensor, widest
    claimed = wider**2 * J @ start.momentum.covariance @ J.T + 1e-12 * np.eye(GENERAL)
    # never wider than knowing nothing, along every direction
    return tensor, np.linalg.inv(np.linalg.inv(claimed) + np.linalg.inv(widest))


def _by_parameters(tensor: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(5, 5): change of the inertia's parameters by `directions` (5, 3, 3)."""
    h = 1e-6 * float(np.linalg.eigvalsh(tensor)[0])
    pairs = ((cholesky_parameters(tensor + h * d), cholesky_parameters(tensor - h * d)) for d in directions)
    return np.stack([(up - down) / (2 * h) for up, down in pairs], -1)


def _k_sigma(tensor: np.ndarray, spread: np.ndarray) -> float:
    """Larger 1-sigma of k1 and k2, by first-order change of the moments."""
    J, _ = cholesky_ratio_derivatives(cholesky_parameters(tensor))
    return float(np.sqrt(np.max(np.diag(J @ spread @ J.T))))


def _fine(problem: Problem, start: Any, row: int) -> float:
    """1-sigma of a feature's place at the start, from one sight of it [m]."""
    distance = float(np.linalg.norm(start.position[row]))
    if problem.stereo:
        return WIDER * float(point_sigma(problem, distance))
    # one camera: depth comes from the turning body; a pixel at a lever of a tenth of a turn
    return 10 * WIDER * distance * float(problem.sigma_px[0] / problem.cameras[0].intrinsics[0])


def _first_slots(problem: Problem, known: np.ndarray, first: int) -> np.ndarray:
    """The features to begin with: those placed and seen longest; slots left over wait for later ones."""
    count = problem.seen[first:].sum(axis=(0, 1))
    order = known[np.lexsort((known, -count[known]))]
    slots = np.full(min(SLOTS, problem.uv.shape[2]), -1)
    chosen = np.sort(order[: len(slots)])
    slots[: len(chosen)] = chosen
    return slots


def place_feature(
    setup: Setup, problem: Problem, epoch: int, feature: int, state: State
) -> tuple[np.ndarray, np.ndarray] | None:
    """Where a feature is at its first sight, (3,) and covariance (3, 3) in inertial axes from the chaser; or None.

    Two cameras triangulate it; one camera puts it on its ray at the body's distance, as deep as the body is large.
    """
    from massprops.sensing.stereo import triangulate

    C, _ = setup.surroundings.camera_frame(float(problem.times[epoch]))
    uv = problem.uv[epoch, :, feature]
    if problem.stereo:
        point, covariance = triangulate(problem.cameras, uv, problem.sigma_px)
        if not np.isfinite(point).all():
            return None
        covariance = 4.0 * covariance
    else:
        camera = problem.cameras[0]
        ray = np.array([*(uv[0] - camera.intrinsics[2:]) / camera.intrinsics[:2], 1.0])
        depth = float((camera.R @ (C.T @ state.r[0] - camera.t))[2])
        if not np.isfinite(ray).all() or depth <= 0:
            return None
        point = camera.R.T @ (depth * ray) + camera.t
        across = (2 * depth * problem.sigma_px[0] / camera.intrinsics[0]) ** 2
        along = camera.R.T @ ray / np.linalg.norm(ray)
        covariance = across * np.eye(3) + setup.size**2 * np.outer(along, along)
    if np.linalg.norm(C @ point - state.r[0]) > 4 * setup.size + 6 * np.sqrt(np.trace(covariance)):
        return None
    return C @ point, C @ covariance @ C.T


def body_points(state: State) -> np.ndarray:
    """(m, 3) features of the one run, from the centre of mass in body axes."""
    return np.asarray(rotate(state.q * [1, -1, -1, -1], state.X[0] - state.r))
