"""The filter of volpe2017, one camera and ranges, from a state in inertial axes: the shared filter with a general inertia."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics.quaternion import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
    rotation_vector,
)
from massprops.estimators.filters import Camera, Measurements, Noise, Run, Settings, State, filter_epochs
from massprops.estimators.filters.setup import chaser_steps
from massprops.sequence.data import Environment

BASE = 17
"""Errors before the features': attitude 3, rate 3, inertia 5, position 3, velocity 3."""
GATE = 4.5
"""Sigmas that one in a hundred thousand good measurements exceeds."""
SPREAD = 3.0
"""Squared distance of the sigma points in standard deviations: it matches a normal distribution's fourth moment."""


@dataclass(frozen=True)
class RangeMotion:
    """State at the first epoch. q (4,) body to inertial; w (3,) body axes [rad/s]; s (5,) the numbers of
    `inertia.cholesky_inertia`; r, v (3,) inertial [m, m/s]; f (m, 3) body axes [m]."""

    q: np.ndarray
    w: np.ndarray
    s: np.ndarray
    r: np.ndarray
    v: np.ndarray
    f: np.ndarray

    def moved(self, d: np.ndarray) -> RangeMotion:
        """The state by a step (17 + 3 m,) of its error."""
        return RangeMotion(
            normalise(multiply(self.q, from_rotation_vector(d[:3]))),
            self.w + d[3:6],
            self.s + d[6:11],
            self.r + d[11:14],
            self.v + d[14:17],
            self.f + d[BASE:].reshape(-1, 3),
        )

    def minus(self, other: RangeMotion) -> np.ndarray:
        """The step that leads from the other state to this one."""
        turn = rotation_vector(multiply(conjugate(other.q), self.q))
        rest = [self.w - other.w, self.s - other.s, self.r - other.r, self.v - other.v, (self.f - other.f).ravel()]
        return np.concatenate([turn, *rest])


@dataclass(frozen=True)
class RangeStart(RangeMotion):
    """With the covariance P (17 + 3 m, 17 + 3 m) of its error."""

    P: np.ndarray


@dataclass(frozen=True)
class RangeData:
    """What one camera and a range sensor measured over n epochs.

    Attributes:
        times: (n,) [s] since the environment's first timestamp; intrinsics: (4,).
        uv: (n, m, 2) of cam0, NaN where not seen; sigma_px. ranges: (n,) [m], NaN where none; sigma_range [m].
        camera: (n, 4) attitude of cam0 (to inertial).
    """

    times: np.ndarray
    intrinsics: np.ndarray
    uv: np.ndarray
    sigma_px: float
    ranges: np.ndarray
    sigma_range: float
    environment: Environment
    camera: np.ndarray

    def part(self, rows: slice) -> RangeData:
        """Some of the epochs."""
        names = ("times", "uv", "ranges", "camera")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def inertial_steps(self) -> np.ndarray:
        """(n, 10) the chaser over the step to each epoch, as of `rule.Steps`, in inertial axes; zeros at the first."""
        still = np.tile([1.0, 0, 0, 0], (len(self.times), 1))
        steps = chaser_steps(self.environment, self.times, still).chaser
        return np.concatenate([np.zeros((1, 10)), steps])


def range_filtered(
    start: RangeStart, data: RangeData, angular_noise: float, acceleration_noise: float, gate: float = GATE
) -> Run:
    """Runs the filter, in the axes of cam0.

    Args:
        angular_noise, acceleration_noise: densities of unmodelled acceleration [rad^2/s^3], [m^2/s^3]; gate: sigmas, 0 for none.
    """
    n, state = len(data.times), camera_state(start, data.camera[0])
    at = np.r_[0, np.arange(n)]
    steps = chaser_steps(data.environment, data.times[at], data.camera[at])
    dt = np.diff(data.times[at])
    variance = np.full((n, 1 + data.uv[0].size), float(data.sigma_px) ** 2)
    variance[:, 0] = float(data.sigma_range) ** 2 if np.isfinite(data.sigma_range) else 1.0
    seen = Measurements(
        dt,
        np.concatenate([data.ranges[:, None], data.uv.reshape(n, -1)], axis=1),
        variance,
        (Camera(np.asarray(data.intrinsics, float), np.eye(3), np.zeros(3)),),
        range=True,
        transition=steps.transition,
        spin=steps.spin,
        chaser=steps.chaser,
    )
    third = float(np.median(dt[1:])) ** 2 / 3.0 if n > 1 else 0.0
    noise = Noise(
        angular_noise, angular_noise * third, k=0.0, position=acceleration_noise * third, velocity=acceleration_noise
    )
    share = SPREAD / len(start.P)
    return filter_epochs(state, seen, noise, Settings(np.sqrt(share), share, gate=gate, gravity=True))


def camera_state(start: RangeStart, camera: np.ndarray) -> State:
    """The start in the axes of cam0, whose attitude is `camera` (4,)."""
    T = np.eye(len(start.P))
    T[:BASE, :BASE] = to_camera(camera)
    R = T[11:14, 11:14]
    q = multiply(conjugate(camera), start.q)
    return State(
        start.w, q, start.s, start.f.copy(), T @ start.P @ T.T, position=R @ start.r, velocity=R @ start.v, moving=True
    )


def to_camera(camera: np.ndarray) -> np.ndarray:
    """(..., 17, 17) from the errors in inertial axes to those of `State`, in axes of attitude `camera` (..., 4)."""
    T = np.zeros((*camera.shape[:-1], BASE, BASE))
    T[..., :3, 3:6] = T[..., 3:6, :3] = np.eye(3)
    T[..., 6:11, 6:11] = np.eye(5)
    T[..., 11:14, 11:14] = T[..., 14:17, 14:17] = rotation_matrix(conjugate(camera))
    return T
