"""The measured motion as a path in attitude and rate that the balance of momentum is written along.

The path is close to the motion, but need not obey any law: how far the motion lies from it is part of what the balance
solves for (`momentum_balance`). Inertial axes are those of attitude0 where there is one, else the body's at the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from massprops.dynamics.quaternion import (
    chained,
    conjugate,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
    rotation_vector,
)

LARGEST_STEP = np.radians(3.0)
"""Rotation between two points of the path: the trapezoid's error per turn is then below 0.02 %."""
MOST_POINTS = 6000
ALIKE_S = 1e-9
"""Times that are one [s]: stamps are whole nanoseconds."""
LEAST_POINTS = 240
"""Of a path: an event is placed to a fraction of a step, and a short record of attitudes has few epochs."""


@dataclass(frozen=True, kw_only=True)
class MotionPath:
    """n points of a motion.

    Attributes:
        t: (n,) [s], rising; q: (n, 4) body to inertial; w: (n, 3) body rates [rad/s].
    """

    t: np.ndarray
    q: np.ndarray
    w: np.ndarray

    @cached_property
    def R(self) -> np.ndarray:
        """(n, 3, 3) body to inertial."""
        return rotation_matrix(self.q)

    @cached_property
    def steps(self) -> np.ndarray:
        """(n - 1, 3) constant body rate that turns each attitude into the next [rad/s]."""
        turn = rotation_vector(multiply(conjugate(self.q[:-1]), self.q[1:]))
        return np.asarray(turn / np.diff(self.t)[:, None])

    @property
    def span(self) -> float:
        """Length [s]."""
        return float(self.t[-1] - self.t[0])

    def turned(self, phi: np.ndarray, w: np.ndarray) -> MotionPath:
        """The path after small turns phi (n, 3) about body axes [rad], with rates w (n, 3)."""
        q = normalise(multiply(self.q, from_rotation_vector(phi)))
        return MotionPath(t=self.t, q=q, w=w)


def path_points(t: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(n,) times that hold every one of t (m,) and leave steps of at most `LARGEST_STEP`; w (m, 3) body rates [rad/s]."""
    turn = np.diff(t) * np.linalg.norm(0.5 * (w[1:] + w[:-1]), axis=1)
    parts = np.maximum(np.ceil(turn / LARGEST_STEP), np.ceil(LEAST_POINTS / len(turn))).astype(int)
    while parts.sum() > MOST_POINTS and parts.max() > 1:
        parts = np.maximum(parts // 2, 1)
    inner = [np.linspace(a, b, k, endpoint=False) for a, b, k in zip(t[:-1], t[1:], parts, strict=True)]
    return np.concatenate([*inner, t[-1:]])


def nearest(points: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(k,) which of rising times (n,) is nearest to each of times (k,)."""
    after = np.clip(np.searchsorted(points, t), 1, len(points) - 1)
    return np.where(t - points[after - 1] < points[after] - t, after - 1, after)


def path_from_rates(t: np.ndarray, w: np.ndarray) -> MotionPath:
    """Rates (m, 3) at times (m,) integrated from an attitude of zero; between samples a cubic spline."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, w)
    points = path_points(t, w)
    step = np.diff(points)[:, None]
    # the mean rate over a step by Simpson's rule; the commutator of its two halves is left out: 1e-5 rad a turn
    mean = (spline(points[:-1]) + 4.0 * spline(points[:-1] + 0.5 * step[:, 0]) + spline(points[1:])) / 6.0
    return MotionPath(t=points, q=normalise(chained(mean * step)), w=spline(points))


def path_from_attitudes(t: np.ndarray, q: np.ndarray, w: np.ndarray, more: np.ndarray | None = None) -> MotionPath:
    """Attitudes (m, 4) and rates (m, 3) at times (m,), joined by cubics in the rotation vector from each to the next, with
    points at `more` times too.

    The rates need only be good enough to say how many whole turns lie between two attitudes.
    """
    points = path_points(t, w)
    if more is not None:
        new = more[np.abs(points[nearest(points, more)] - more) > ALIKE_S]
        points = np.sort(np.concatenate([points, new]))
    at = np.clip(np.searchsorted(t, points, side="right") - 1, 0, len(t) - 2)
    step = np.diff(t)[:, None]
    between = rotation_vector(multiply(conjugate(q[:-1]), q[1:]))
    guess = 0.5 * (w[:-1] + w[1:]) * step
    length = np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 1e-12)
    turns = np.round((np.sum(guess * between, axis=1, keepdims=True) / length - length) / (2 * np.pi))
    between = between * (1.0 + 2 * np.pi * turns / length)
    # rates in the axes of each interval's first attitude: the rotation vector's own rate at both ends
    first, last = w[:-1] * step, _vector_rate(between, w[1:]) * step
    x = ((points - t[at]) / step[at, 0])[:, None]
    v = x * (1.0 - x) ** 2 * first[at] + x**2 * (3.0 - 2.0 * x) * between[at] + x**2 * (x - 1.0) * last[at]
    grown = (1.0 - x) * (1.0 - 3.0 * x) * first[at] + 6.0 * x * (1.0 - x) * between[at] + x * (3.0 * x - 2.0) * last[at]
    out_q = multiply(q[at], from_rotation_vector(v))
    return MotionPath(t=points, q=normalise(out_q), w=_body_rate(v, grown / step[at]))


def _body_rate(v: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Body rates of a rotation vector v (..., 3) that changes at `rate` (the right Jacobian of SO(3))."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    small = angle < 1e-4
    x = np.where(small, 1.0, angle)
    a = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(x)) / x**2)
    b = np.where(small, 1 / 6 - angle**2 / 120, (x - np.sin(x)) / x**3)
    once = np.cross(v, rate)
    return np.asarray(rate - a * once + b * np.cross(v, once))


def _vector_rate(v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Rates (m, 3) of rotation vectors v (m, 3) whose body rates are w (m, 3)."""
    J = np.stack([_body_rate(v, np.broadcast_to(e, v.shape)) for e in np.eye(3)], axis=2)
    return np.asarray(np.linalg.solve(J, w[:, :, None])[:, :, 0])
