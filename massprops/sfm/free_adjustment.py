"""Bundle adjustment of a free rigid body before a still camera: its motion takes the place of the images' poses.

Sides of a body may hang together by next to no points: a box whose ends are white, a panel seen edge-on. The images' own
poses then drift against each other by degrees, and the features, of which each fits, do not say so. But the turning of a
free body has 11 numbers, and its centre of mass passes on a straight line (9 more, with its place in the body). So these and
the points are adjusted together (Gauss and Newton with Levenberg's damping, Cauchy loss, points eliminated).
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.free_motion import MOST_LOG, FreeRotation
from massprops.sfm.points import SparsePoints, residuals
from massprops.sfm.precision import Lens, System, derivatives
from massprops.views import Views

STEP = 1e-5
"""Of the differences by which the motion's derivatives are taken."""

SETTLED = 1e-4
"""Relative gain of a step below which an adjustment ends."""

MOTION, LINE = 11, 9
"""Numbers of the turning, and of the centre of mass in the body, its place and its speed."""


@dataclass(frozen=True)
class Tumble:
    """How a free body moves before the camera.

    Attributes:
        turning: of the body.
        centre: (3,) of mass, in the body.
        place, speed: (3,) of it in the camera at the time `turning.begin`, and its change in a unit of time.
    """

    turning: FreeRotation
    centre: np.ndarray
    place: np.ndarray
    speed: np.ndarray

    def clock(self, times: np.ndarray) -> np.ndarray:
        """(n,) since the beginning, in units of time."""
        return (np.asarray(times, float) - self.turning.begin) / self.turning.unit

    def poses(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Body to camera at times (n,): (n, 3, 3) and (n, 3)."""
        R = self.turning.attitudes(times)[0]
        return R, self.place + self.clock(times)[:, None] * self.speed - R @ self.centre

    def changed(self, x: np.ndarray) -> Tumble:
        """The motion changed by x (20,): of the turning, the centre of mass, its place and its speed."""
        c, p, v = x[MOTION : MOTION + LINE].reshape(3, 3)
        return Tumble(self.turning.changed(x[:MOTION]), self.centre + c, self.place + p, self.speed + v)


def fit_line(turning: FreeRotation, times: np.ndarray, t: np.ndarray, slimness: float) -> Tumble:
    """The tumble of given turning whose shifts come nearest to t (n, 3), at times (n,); slimness: as of `fit_centres`."""
    R = turning.attitudes(times)[0]
    clock = (times - turning.begin) / turning.unit
    ones = np.broadcast_to(np.eye(3), R.shape)
    weight = np.array([1.0, 1.0, slimness])[:, None]
    A = weight * np.concatenate([-R, ones, clock[:, None, None] * ones], axis=2)
    x, *_ = np.linalg.lstsq(A.reshape(-1, LINE), (weight[:, 0] * t).ravel(), rcond=None)
    return Tumble(turning, *x.reshape(3, 3))


def adjust_tumble(
    model: pycolmap.Reconstruction,
    tumble: Tumble,
    clock: Callable[[str], float],
    loss_px: float,
    free_focal: bool,
) -> Tumble:
    """Adjusts a motion and the points that its images see, in place; the images of a single camera get its poses.

    Args:
        clock: time of an image by its name.
        loss_px: scale of the Cauchy loss.

    Raises:
        NotPossible: no image shows a point any more.
    """
    views, ids = to_views(model)
    points = to_points(model, ids)
    if not len(views) or not len(points.obs_view):
        raise NotPossible("the images do not follow one free motion: none is left of those that were held to it")
    system = MotionSystem(views, points, np.array([clock(n) for n in views.names]), loss_px, free_focal)
    state = system.settled(State(tumble, 0.0, system.points.xyz), 20)
    _write(model, ids, system, state)
    for camera in model.cameras.values():
        camera.params = [
            p * np.exp(state.focal) if k in camera.focal_length_idxs() else p for k, p in enumerate(camera.params)
        ]
    return state.tumble


def hold_to_tumble(
    model: pycolmap.Reconstruction, tumble: Tumble, clock: Callable[[str], float], loss_px: float
) -> None:
    """Gives the images of a single camera the poses of a motion, in place, and adjusts the points to these; as `adjust_tumble`."""
    views, ids = to_views(model)
    system = MotionSystem(views, to_points(model, ids), np.array([clock(n) for n in views.names]), loss_px, False)
    _write(model, ids, system, system.with_points_settled(State(tumble, 0.0, system.points.xyz), 10))


def _write(model: pycolmap.Reconstruction, ids: list[int], system: MotionSystem, found: State) -> None:
    for image_id, R, t in zip(ids, *found.tumble.poses(system.times), strict=True):
        frame = model.frame(model.image(image_id).frame_id)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(R), t)
        frame.set_cam_from_world(model.image(image_id).camera_id, pose)
    for point_id, xyz in zip(system.points.id.tolist(), found.xyz, strict=True):
        model.point3D(point_id).xyz = xyz


def cauchy_cost(views: Views, points: SparsePoints, loss_px: float) -> float:
    """Sum of the Cauchy loss of all observations [px^2]."""
    square = (residuals(views, points) ** 2).sum(1)
    return 0.5 * loss_px**2 * float(np.log1p(square / loss_px**2).sum())


@dataclass(frozen=True)
class State:
    """A motion, the logarithm of the focal length's change, and the points (m, 3)."""

    tumble: Tumble
    focal: float
    xyz: np.ndarray


@dataclass(frozen=True)
class Linear:
    """About a state: residuals (k, 2), weights (k,), the system of poses and lens, and the derivatives `columns` (6n + e, q) of these
    by the numbers of the motion and the focal length; what the points add to a score, (m, 3)."""

    residual: np.ndarray
    weight: np.ndarray
    system: System
    columns: np.ndarray
    of_points: np.ndarray
    score: np.ndarray


class MotionSystem:
    """Observations, and what of them a state misses."""

    def __init__(self, views: Views, points: SparsePoints, times: np.ndarray, loss_px: float, free_focal: bool) -> None:
        self.views, self.points, self.times, self.loss_px, self.free = views, points, times, loss_px, free_focal

    def at(self, state: State) -> tuple[Views, SparsePoints]:
        """Views and points as the state has them."""
        R, t = state.tumble.poses(self.times)
        K = self.views.K.copy()
        K[:, [0, 1], [0, 1]] *= np.exp(state.focal)
        return replace(self.views, R=R, t=t, K=K), replace(self.points, xyz=state.xyz)

    def cost(self, state: State) -> float:
        """Sum of the loss [px^2]; infinite where a point is no longer before a camera."""
        with np.errstate(all="ignore"):
            cost = cauchy_cost(*self.at(state), self.loss_px)
        return cost if np.isfinite(cost) else np.inf

    def linear(self, state: State) -> Linear:
        """See `Linear`."""
        views, points = self.at(state)
        r = residuals(views, points)
        weight = 1 / (1 + (r**2).sum(1) / self.loss_px**2)
        s = derivatives(views, points)
        lens = Lens([np.stack([s.x * s.radial, s.y * s.radial], 1) * s.f[:, None]] if self.free else [], {}, {})
        system = System(len(views), points, s, lens, weight)
        of_points = system.point_jacobian(r, weight)
        score = np.asarray(system.scores(r, weight).sum(axis=0)).ravel()
        return Linear(r, weight, system, self.columns(state.tumble, views.R, self.times), of_points, score)

    def columns(self, tumble: Tumble, R: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(6n + e, 20 + e) derivatives of turns and shifts of images at times (n,), R (n, 3, 3), and of the lens."""
        from scipy.spatial.transform import Rotation

        n, e = len(R), int(self.free)
        ends = tumble.turning.attitudes(times, np.concatenate([STEP * np.eye(MOTION), -STEP * np.eye(MOTION)]))
        change = np.einsum("mnij,mnlj->mnil", ends[:MOTION], ends[MOTION:]).reshape(-1, 3, 3)
        turn = Rotation.from_matrix(change).as_rotvec().reshape(MOTION, n, 3) / (2 * STEP)
        J = np.zeros((n, 6, MOTION + LINE + e))
        J[:, :3, :MOTION] = turn.transpose(1, 2, 0)
        J[:, 3:, :MOTION] = -np.cross(turn, R @ tumble.centre).transpose(1, 2, 0)
        J[:, 3:, MOTION : MOTION + 3] = -R
        J[:, 3:, MOTION + 3 : MOTION + 6] = np.eye(3)
        J[:, 3:, MOTION + 6 : MOTION + 9] = tumble.clock(times)[:, None, None] * np.eye(3)
        lens = np.eye(MOTION + LINE + e)[MOTION + LINE :]
        return np.concatenate([J.reshape(6 * n, -1), lens])

    def with_points_settled(self, state: State, iterations: int) -> State:
        """The state with its points where its motion has them best."""
        cost = self.cost(state)
        for _ in range(iterations):
            at = self.linear(state)
            moved = at.system.points_follow(np.zeros(at.columns.shape[0]), at.of_points)
            trial = replace(state, xyz=state.xyz + moved)
            before, cost = cost, self.cost(trial)
            if not cost < before:
                break
            state = trial
            if not cost < before * (1 - SETTLED):
                break
        return state

    def settled(self, state: State, iterations: int) -> State:
        """The state from which no step gains."""
        cost, damping = self.cost(state), 1e-4
        for _ in range(iterations):
            at = self.linear(state)
            J = at.columns
            H, g = J.T @ at.system.normal @ J, J.T @ at.score
            unit = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
            before = cost
            for _ in range(8):
                scaled = H * unit[:, None] * unit + damping * np.eye(len(H))
                step = _bounded(-unit * np.linalg.solve(scaled, unit * g), state.tumble)
                trial, cost = state, np.inf
                if _within_reach(step, state.tumble):
                    moved = at.system.points_follow(J @ step, at.of_points)
                    focal = state.focal + float(step[-1]) if self.free else 0.0
                    trial = State(state.tumble.changed(step), focal, state.xyz + moved)
                    cost = self.cost(trial)
                if cost < before:
                    state, damping = trial, 0.2 * damping
                    break
                damping = max(10 * damping, 1e-6)
            if not cost < before * (1 - SETTLED):
                break
        return state


def _bounded(step: np.ndarray, tumble: Tumble) -> np.ndarray:
    """The step, as far as the logarithm of the inertia stays within its bounds. A motion may begin at one: where little tells a ratio, the
    attitudes' errors do."""
    out = step.copy()
    out[6:MOTION] = np.clip(step[6:MOTION] + tumble.turning.inertia, -MOST_LOG, MOST_LOG) - tumble.turning.inertia
    return out


def _within_reach(step: np.ndarray, tumble: Tumble) -> bool:
    """Whether a step leaves the turning one that can be followed: rates that run away take for ever."""
    turn, rate = step[:3], step[3:6]
    slow = np.linalg.norm(rate) < 0.5 * np.linalg.norm(tumble.turning.rate)
    return bool(np.isfinite(step).all() and np.linalg.norm(turn) < 1 and slow)
