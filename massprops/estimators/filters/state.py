"""Data of the unscented filter, and the call that runs it, compiled."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from massprops.core.compiling import compiled
from massprops.estimators.filters.rule import RATIO, Record, Rule, Seen, Steps
from massprops.sensing.pinhole import Pinhole as Camera

KERNEL = (
    "massprops.dynamics.kernels",
    "massprops.estimators.filters.rule",
    "massprops.estimators.filters.components",
    "massprops.estimators.filters.algebra",
    "massprops.estimators.filters.prediction",
    "massprops.estimators.filters.sight",
    "massprops.estimators.filters.correction",
)
LINEARISED = "massprops.estimators.filters.linearised"
BODY_AXES = "massprops.estimators.filters.body_axes"
GRAVITY = "massprops.estimators.filters.gravity"
"""Their functions take the place of those before."""


@dataclass(frozen=True)
class Settings:
    """How the filter works.

    Attributes:
        alpha, beta, kappa: of the scaled sigma points (kabir2025 section 3.2: 0.1, 2, 0).
        gate: innovations beyond this many sigma are rejected with all measurements of their group; 0 for none.
        largest_turn: rotation per Runge-Kutta step [rad].
        additive: the paper's additive quaternion, four components, in place of the three of a multiplicative error.
        rounds: linearisations of an update at most: 1 for an extended Kalman filter, more for an iterated one; 0 for the
            unscented update.
        gravity: the planet turns the body by its gradient and pulls it to every order; for an inertia in body axes.
    """

    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0
    gate: float = 5.0
    largest_turn: float = 0.1
    additive: bool = False
    rounds: int = 0
    gravity: bool = False


UNSCENTED = Settings()
EXTENDED, ITERATED = Settings(alpha=0.01, rounds=1), Settings(alpha=0.01, rounds=6)
"""The update rules: unscented, and extended and iterated extended Kalman filter, whose sigma points lie so close that they
give derivatives."""


@dataclass(frozen=True)
class State:
    """Mean and covariance. Rotation is of the principal frame, I = diag(exp(k1), 1, exp(-k2)); or of any body axes, with the
    five numbers of `inertia.cholesky_inertia` in place of k1, k2.

    The error's order: rates 3, attitude 3 (body axes [rad]; or 4, additive), k1, k2 (or 5), then, where they are estimated,
    axes 3 (turn of `axes` on its right), position 3, velocity 3, and 3 for each feature.

    Attributes:
        w: (3,) [rad/s], principal axes. q: (4,) principal frame to cam0. k: (2,) or (5,).
        axes: (4,) turns vectors of the measured body frame (attitude0, imu0) into the principal frame.
        position: (3,) [m], velocity: (3,) inertial velocity in cam0's axes [m/s], of the centre of mass.
        features: (m, 3) principal axes [m].
        P: (N, N) covariance of the error.
        axes_free, moving: whether axes, and position and velocity, are in the error.
    """

    w: np.ndarray
    q: np.ndarray
    k: np.ndarray
    features: np.ndarray
    P: np.ndarray
    axes: np.ndarray = field(default_factory=lambda: np.array([1.0, 0, 0, 0]))
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes_free: bool = False
    moving: bool = False

    def places(self, additive: bool = False) -> dict[str, slice]:
        """Rows of P by name."""
        na = 4 if additive else 3
        out = {"w": slice(0, 3), "attitude": slice(3, 3 + na)}
        at = 3 + na + len(self.k)
        out["k"] = slice(3 + na, at)
        if self.axes_free:
            out["axes"], at = slice(at, at + 3), at + 3
        if self.moving:
            out["position"], out["velocity"], at = slice(at, at + 3), slice(at + 3, at + 6), at + 6
        out["features"] = slice(at, at + 3 * len(self.features))
        return out


@dataclass(frozen=True)
class Noise:
    """Process noise, variance per second of each error component."""

    w: float = 1e-14
    attitude: float = 1e-14
    k: float = 1e-14
    axes: float = 0.0
    position: float = 0.0
    velocity: float = 1e-12
    features: float = 0.0

    def diagonal(self, state: State, additive: bool = False) -> np.ndarray:
        """(N,) in the order of the error."""
        Q = np.zeros(len(state.P))
        for name, rows in state.places(additive).items():
            Q[rows] = getattr(self, name)
        return Q


@dataclass(frozen=True)
class Measurements:
    """Epochs of measurements; NaN where there is none. n epochs, m features, c cameras.

    Channels: attitude 3, rates 3, range 1 (those in use), then per feature u, v per camera, the disparity u1 - u0,
    and the rates of u, v per camera.

    Attributes:
        dt: (n,) [s] since the epoch before; 0 at the first.
        z, variance: (n, ny) in the channels' order; of an attitude any finite z marks it as measured.
        cameras: c pinhole cameras.
        attitude: (n, 4) or None.
        rates, range: whether these channels are in z.
        disparity, flow: likewise.
        pinned: (n,) True where features are measured as if the centre of mass were at `reference` and at rest.
        reference: (3,) [m].
        transition: (n, 6, 6) of position and velocity over dt, or None for uniform motion.
        spin: (n, 4) turn of the chaser over dt as a factor on the left of q, or None.
        chaser: (n, 10) its path over dt and mu, as of `rule.Steps`, or None: needed only in gravity.
    """

    dt: np.ndarray
    z: np.ndarray
    variance: np.ndarray
    cameras: tuple[Camera, ...] = ()
    attitude: np.ndarray | None = None
    rates: bool = False
    range: bool = False
    disparity: bool = False
    flow: bool = False
    pinned: np.ndarray | None = None
    reference: np.ndarray = field(default_factory=lambda: np.zeros(3))
    transition: np.ndarray | None = None
    spin: np.ndarray | None = None
    chaser: np.ndarray | None = None

    @property
    def extras(self) -> tuple[int, int, int]:
        """Channels of attitude, rates and range."""
        return (3 if self.attitude is not None else 0, 3 if self.rates else 0, 1 if self.range else 0)

    @property
    def per_feature(self) -> int:
        """Channels of one feature."""
        c = len(self.cameras)
        return 2 * c * (2 if self.flow else 1) + int(self.disparity)

    def groups(self, features: int) -> np.ndarray:
        """(ny,) measurements that stand or fall together: one sensor's, or one feature's in one camera."""
        c = len(self.cameras)
        one = [i for i in range(c) for _ in range(2)] + [c] * self.disparity
        one += [c + 1 + i for i in range(c) for _ in range(2)] * self.flow
        kinds = 2 * c + 2
        head = [0] * self.extras[0] + [1] * self.extras[1] + [2] * self.extras[2]
        return np.array(head + [3 + kinds * i + g for i in range(features) for g in one], np.int64)


@dataclass(frozen=True)
class Run:
    """What the filter saw and said; n epochs.

    Attributes:
        w, q, k, axes, position, velocity: (n, ...) means after each epoch.
        sigma: (n, N) of each error component.
        block: (n, b, b) covariance of the leading errors: rates, attitude and k.
        nis: (n,) normalised innovation squared; used, gated: (n,) measurements.
        last: state at the end.
        cpu_s: CPU time of the filter alone.
    """

    w: np.ndarray
    q: np.ndarray
    k: np.ndarray
    axes: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    sigma: np.ndarray
    block: np.ndarray
    nis: np.ndarray
    used: np.ndarray
    gated: np.ndarray
    last: State
    cpu_s: float


PARTS = ("w", "q", "k", "axes", "position", "velocity")
"""Of the mean, in the loop's order; the features follow."""
Loop = Callable[[np.ndarray, np.ndarray, Steps, Seen, Rule, Record], None]
"""`correction.run_loop`, or another that does the same."""


def rule_of(state: State, seen: Measurements, settings: Settings) -> Rule:
    """What the loop is told of the state, the channels and the settings."""
    attitude, rates, span = seen.extras
    return Rule(
        additive=settings.additive,
        axes_free=state.axes_free,
        moving=state.moving,
        attitude=attitude,
        rates=rates,
        range=span,
        disparity=seen.disparity,
        flow=seen.flow,
        gamma=float(settings.alpha * np.sqrt(len(state.P) + settings.kappa)),
        excess=float(settings.beta - settings.alpha**2),
        gate=float(settings.gate),
        largest_turn=float(settings.largest_turn),
        rounds=settings.rounds,
    )


def _steps(seen: Measurements, noise: np.ndarray) -> Steps:
    n = len(seen.dt)
    F = seen.transition
    if F is None:
        F = np.broadcast_to(np.eye(6), (n, 6, 6)).copy()
        F[:, :3, 3:] = seen.dt[:, None, None] * np.eye(3)
    spin = np.tile([1.0, 0, 0, 0], (n, 1)) if seen.spin is None else np.ascontiguousarray(seen.spin, float)
    chaser = np.zeros((n, 10)) if seen.chaser is None else np.ascontiguousarray(seen.chaser, float)
    return Steps(np.ascontiguousarray(seen.dt, float), np.ascontiguousarray(F, float), spin, noise, chaser)


def _seen(seen: Measurements, features: int) -> Seen:
    n = len(seen.dt)
    place = np.full((n, 3), np.nan)
    if seen.pinned is not None:
        place[seen.pinned] = seen.reference
    eyes = [np.concatenate([x.intrinsics, np.ravel(x.R), x.t]) for x in seen.cameras]
    return Seen(
        np.array(seen.z, float),
        np.ascontiguousarray(seen.variance, float),
        np.zeros((n, 4)) if seen.attitude is None else np.ascontiguousarray(seen.attitude, float),
        place,
        np.array(eyes, float).reshape(len(eyes), 16),
        seen.groups(features),
    )


def filter_epochs(
    state: State, seen: Measurements, noise: Noise, settings: Settings | None = None, loop: Loop | None = None
) -> Run:
    """Runs the filter over all epochs from `state`, the belief before the first epoch's measurements.

    Args:
        loop: in place of the compiled one.
    """
    settings = settings or Settings()
    n, size, m = len(seen.dt), len(state.P), len(state.features)
    assert seen.z.shape[1] == sum(seen.extras) + m * seen.per_feature, "channels and features disagree"
    mean = [*(getattr(state, name) for name in PARTS), np.ravel(state.features)]
    x, P = np.concatenate(mean).astype(float), np.array(state.P, float)
    b = state.places(settings.additive)["k"].stop
    # where one part of the state ends and the next begins: attitude, inertia, axes, position, velocity, features
    edges = np.cumsum([3, RATIO - 3, len(state.k), 4, 3, 3])
    record = Record(np.zeros((n, edges[-1])), np.zeros((n, size)), np.zeros((n, b, b)), np.zeros((n, 3)))
    steps = _steps(seen, noise.diagonal(state, settings.additive))
    if loop is None:
        parts = ((LINEARISED, settings.rounds > 0), (BODY_AXES, len(state.k) > 2), (GRAVITY, settings.gravity))
        loop = compiled("run_loop", *KERNEL, *(name for name, taken in parts if taken), one_piece=True)
    given = (x, P, steps, _seen(seen, m), rule_of(state, seen, settings), record)
    begin = time.process_time()
    loop(*given)
    spent = time.process_time() - begin
    *ends, features = np.split(x, edges)
    mean_now: dict[str, Any] = dict(zip(PARTS, ends, strict=True))
    last = replace(state, **mean_now, features=features.reshape(m, 3), P=P)
    return Run(
        **dict(zip(PARTS, np.split(record.mean, edges[:-1], axis=1), strict=True)),
        sigma=record.sigma,
        block=record.block,
        nis=record.tally[:, 0],
        used=record.tally[:, 1].astype(int),
        gated=record.tally[:, 2].astype(int),
        last=last,
        cpu_s=spent,
    )
