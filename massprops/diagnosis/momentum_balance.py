"""The balance of angular momentum along a measured path: linear in inertia, momentum and nearly every effect.

A body with attitude R (body to inertial), rate w in body axes, inertia I and momentum h of what turns inside obeys

    R (I w + h) = L0 + integral of R torque dt.

Solved for the rate, every row carries the noise of one measurement and no other:

    w = I^-1 (R^T L - h),

so the noise of rates stands in no column, as it does where measured rates are multiplied by the inertia, which draws the
estimate toward bodies along whose axes noise is explained by itself. What is left of errors in variables:

- A gyroscope's path is its own rates integrated. Their white noise turns it by a random walk of sigma sqrt(dt t), next to
  the noise of a row the root of the turn between two rows times the whole turn. Scale and misalignment turn it by a part of
  the whole angle. Both have columns.
- A path through attitudes is off by a turn phi, which is the row itself: phi' = w - u - u x phi, u the path's rate, and
  w answers it by I^-1 (R^T L) x phi. Columns of w and phi come together from one integration along the path; solving again
  along the path that was found is Gauss and Newton's method for the likelihood of the attitudes.

The inertia enters by the logarithm of its second moments of mass, so that every step leads to a body that can be; about
the present guess I_c a change dI answers with -I_c^-1 dI w_c, w_c the rate predicted, and a few passes settle it.

Units: momenta over the mean moment, trace I = 3, so torques in rad/s^2 and momenta in rad/s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from massprops.diagnosis.motion_path import MotionPath
from massprops.dynamics.inertia import DIRECTIONS
from massprops.geometry.vectors import skew

INERTIA = 5
"""Columns of the inertia: the ways one of trace 3 can change."""


@lru_cache(maxsize=16)
def _principal(shape: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and eigenvectors of the logarithm of second moments: every pass asks for them several times."""
    return tuple(np.linalg.eigh(np.einsum("a,aij->ij", np.frombuffer(shape), DIRECTIONS)))  # type: ignore[return-value]


def inertia_of(shape: np.ndarray) -> np.ndarray:
    """(3, 3) inertia, trace 3, of the logarithm (5,) of its second moments of mass: any numbers are a body's.

    I = tr(P) - P with the second moments P = exp(sum shape_k E_k), scaled; zeros are a ball.
    """
    return _inertia(np.asarray(shape, float).tobytes()).copy()


@lru_cache(maxsize=16)
def _inertia(shape: bytes) -> np.ndarray:
    value, vector = _principal(shape)
    P = 1.5 * np.exp(value - value.max())
    return np.asarray(1.5 * np.eye(3) - (vector * P / np.sum(np.exp(value - value.max()))) @ vector.T)


def shape_of(inertia: np.ndarray) -> np.ndarray:
    """(5,) logarithm of the second moments of an inertia (3, 3), none of them below .002 of their sum."""
    value, vector = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    log = np.log(np.maximum(value / np.sum(np.maximum(value, 0.0)), 0.002))
    return np.asarray(np.einsum("aij,ij->a", DIRECTIONS, (vector * (log - log.mean())) @ vector.T))


def inertia_jacobian(shape: np.ndarray) -> np.ndarray:
    """(5, 3, 3) derivatives of `inertia_of` (Daleckii and Krein's formula for a function of a matrix)."""
    value, vector = _principal(np.asarray(shape, float).tobytes())
    e = np.exp(value - value.max())
    apart = value[:, None] - value
    alike = np.abs(apart) < 1e-7
    ratio = np.where(alike, 0.5 * (e[:, None] + e), (e[:, None] - e) / np.where(alike, 1.0, apart))
    inside = np.einsum("ji,ajk,kl->ail", vector, DIRECTIONS, vector) * ratio
    total = e.sum()
    grown = np.einsum("aii->a", inside)
    dP = 1.5 * (inside / total - grown[:, None, None] * np.diag(e) / total**2)
    return np.asarray(-np.einsum("ij,ajk,lk->ail", vector, dP, vector))


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Measurements of a motion, m rows of three components.

    Attributes:
        at: (m,) points of the path; measured: (m, 3) rates [rad/s], or turns of the attitude measured from the path
            [rad], body axes; sigma: (m,) or (m, 3) 1-sigma; rates: which of the two they are.
        gyroscope: rates beside attitudes, their rows after those of the attitudes, or None. all: m and theirs.
    """

    at: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    rates: bool
    gyroscope: Rows | None = None

    @property
    def spread(self) -> np.ndarray:
        """(3 all,) 1-sigma of each number measured."""
        sigmas = np.repeat(self.sigma, 3) if self.sigma.ndim == 1 else self.sigma.reshape(-1)
        return sigmas if self.gyroscope is None else np.concatenate([sigmas, self.gyroscope.spread])

    @property
    def values(self) -> np.ndarray:
        """(all, 3) measured."""
        return self.measured if self.gyroscope is None else np.concatenate([self.measured, self.gyroscope.measured])

    @property
    def points(self) -> np.ndarray:
        """(all,) of the path."""
        return self.at if self.gyroscope is None else np.concatenate([self.at, self.gyroscope.at])

    @property
    def groups(self) -> np.ndarray:
        """(3 all,) which factor of the noise each number has: one for each axis of a gyroscope, one for attitudes, and one
        for a gyroscope beside them."""
        if self.rates:
            return np.tile(np.arange(3), len(self.at))
        beside = 0 if self.gyroscope is None else len(self.gyroscope.at)
        return np.repeat([0, 1], [3 * len(self.at), 3 * beside])


@dataclass(frozen=True, kw_only=True)
class Forcing:
    """k unknowns that enter linearly, along a path of n points.

    Attributes:
        momentum: (n, 3, k) added to the momentum, inertial axes, or None; internal: (n, 3, k) momentum inside the body
            against it, body axes, or None; both over the mean moment [rad/s]. rate: (n, 3, k) turning that no momentum
            stands behind, body axes [rad/s], or None.
    """

    momentum: np.ndarray | None = None
    internal: np.ndarray | None = None
    rate: np.ndarray | None = None

    @property
    def part(self) -> np.ndarray | None:
        """The first of the three that is there."""
        return next((p for p in (self.momentum, self.internal, self.rate) if p is not None), None)

    @property
    def count(self) -> int:
        return 0 if self.part is None else self.part.shape[2]


def torque_forcing(path: MotionPath, torque: np.ndarray) -> Forcing:
    """What torques (n, 3, k) in body axes over the mean moment [rad/s^2] add to the momentum: their integral in space."""
    return Forcing(momentum=integral(path.t, path.R @ torque))


def integral(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, ...) running integral from the first time, by the trapezoid."""
    out = np.zeros_like(values)
    step = np.diff(t).reshape(-1, *[1] * (values.ndim - 1))
    np.cumsum(0.5 * step * (values[1:] + values[:-1]), axis=0, out=out[1:])
    return out


@dataclass(frozen=True, kw_only=True)
class Balance:
    """The balance along one path about one guess.

    Attributes:
        path: n points; shape: (5,) of the inertia (`inertia_of`); momentum: (n, 3) of all, body axes, at the guess; rate: (n, 3)
            predicted at the guess [rad/s]; rows: what was measured.
    """

    path: MotionPath
    shape: np.ndarray
    momentum: np.ndarray
    rate: np.ndarray
    rows: Rows

    @cached_property
    def inertia(self) -> np.ndarray:
        """(3, 3), trace 3."""
        return inertia_of(self.shape)

    @cached_property
    def inverse(self) -> np.ndarray:
        """(3, 3) of the inertia."""
        return np.asarray(np.linalg.inv(self.inertia))

    def rate_of(self, momentum: np.ndarray) -> np.ndarray:
        """(n, 3, 1) rate along the path when the momentum is `momentum` (3,), inertial axes, and nothing else acts."""
        x, y, z = momentum
        R = self.path.R  # component by component: a product for each point takes five times as long
        return np.asarray((x * R[:, 0] + y * R[:, 1] + z * R[:, 2]) @ self.inverse)[:, :, None]

    @property
    def base_count(self) -> int:
        """Columns that every hypothesis has: inertia, momentum at the start, and with attitudes the turn at the start."""
        return INERTIA + (3 if self.rows.rates else 6)

    def constant(self, momentum: np.ndarray) -> np.ndarray:
        """(all, 3) what the rows hold when the momentum at the start is `momentum` (3,), inertial axes, and every other
        unknown zero: near the rows, so that no large numbers stand against each other."""
        rate = self.rate_of(momentum)
        return self._rows_of(rate, None if self.rows.rates else self._turned(rate, own=True))[:, :, 0]

    @cached_property
    def free(self) -> np.ndarray:
        """(n, 3, 8) rate along the path itself of a unit of each of the inertia's shape and of the momentum at the start."""
        by_shape = -np.swapaxes(self.rate @ np.swapaxes(self.inverse @ inertia_jacobian(self.shape), 1, 2), 0, 1)
        return np.concatenate([np.swapaxes(by_shape, 1, 2), self.from_space], axis=2)

    @cached_property
    def from_space(self) -> np.ndarray:
        """(n, 3, 3) rate of a unit of momentum along each inertial axis."""
        return np.swapaxes((self.path.R.reshape(-1, 3) @ self.inverse).reshape(-1, 3, 3), 1, 2)

    def base(self) -> np.ndarray:
        """(all, 3, `base_count`) columns of `free`, and with attitudes of the turn at the start."""
        out = self.response(self.free)
        if self.rows.rates:
            return out
        none = np.zeros((len(self.path.t), 3, 3))
        return np.concatenate([out, self._rows_of(none, self._turned(none, np.eye(3)))], axis=2)

    def sensor(self) -> np.ndarray:
        """(all, 3, 9 or 13) columns of a gyroscope's scale and misalignment S: it shows (1 + S) w, and a path that was
        integrated from it is turned by as much. One beside attitudes has an offset too, and a clock that is late [s] or early;
        attitudes have none of it."""
        shown = np.einsum("ij,nk->nijk", np.eye(3), self.rate).reshape(len(self.rate), 3, 9)
        if self.rows.gyroscope is not None:
            offset = np.broadcast_to(np.eye(3), (len(self.rate), 3, 3))
            late = -np.gradient(self.rate, self.path.t, axis=0)[:, :, None]
            out = np.zeros((len(self.rows.points), 3, 13))
            out[len(self.rows.at) :] = np.concatenate([shown, offset, late], axis=2)[self.rows.gyroscope.at]
            return out
        R = self.path.R
        turn = -np.swapaxes(R, 1, 2) @ integral(self.path.t, R @ shown)
        return np.asarray((shown + self._answer @ turn)[self.rows.at])

    def axes(self) -> np.ndarray:
        """(all, 3, 3) rows of a small turn [rad] of the sensors' axes in the body: rates w are shown as w + turn x w, and attitudes as
        much the other way. A path that was integrated from such rates is turned too."""
        shown = -skew(self.rate)
        if self.rows.rates:
            return np.asarray((shown + self._answer)[self.rows.at])
        of_attitudes = np.broadcast_to(-np.eye(3), (len(self.rows.at), 3, 3))
        beside = self.rows.gyroscope
        return np.asarray(of_attitudes if beside is None else np.concatenate([of_attitudes, shown[beside.at]]))

    def turned(self, turn: np.ndarray) -> np.ndarray:
        """(all, 3, k) rows of rates along a path that is turned by (n, 3, k), inertial axes."""
        return np.asarray((self._answer @ np.swapaxes(self.path.R, 1, 2) @ turn)[self.rows.at])

    def columns(self, forcing: Forcing) -> np.ndarray:
        """(all, 3, k) response of the rows to a unit of each unknown."""
        return self.response(self.forced(forcing))

    def forced(self, forcing: Forcing) -> np.ndarray:
        """(n, 3, k) rate along the path itself of a unit of each unknown."""
        out = np.zeros((len(self.path.t), 3, forcing.count))
        if forcing.momentum is not None:
            out += self.from_space @ forcing.momentum
        if forcing.internal is not None:
            out -= self.inverse @ forcing.internal
        return np.asarray(out if forcing.rate is None else out + forcing.rate)

    def response(self, rate: np.ndarray) -> np.ndarray:
        """(all, 3, k) rows of a change of the rate (n, 3, k)."""
        return self._rows_of(rate, None if self.rows.rates else self._turned(rate))

    def _rows_of(self, rate: np.ndarray, turned: np.ndarray | None) -> np.ndarray:
        """(all, 3, k) rows of a rate along the path itself (n, 3, k) and of the turns from it (n, 3, k), None for rates."""
        if turned is None:
            return np.asarray(rate[self.rows.at])
        of_attitudes, beside = turned[self.rows.at], self.rows.gyroscope
        if beside is None:
            return np.asarray(of_attitudes)
        return np.concatenate([of_attitudes, rate[beside.at] + self._answer[beside.at] @ turned[beside.at]])

    def motion(self, rate: np.ndarray, turn: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Rate (n, 3) and turn (n, 3) from the path when the balance gives this rate (n, 3) along the path itself, and
        `turn` (3,) at the start."""
        if self.rows.rates:
            return rate, np.zeros_like(rate)
        first = np.zeros((3, 1)) if turn is None else turn[:, None]
        phi = self._turned(rate[:, :, None], first, own=True)
        return rate + (self._answer @ phi)[:, :, 0], phi[:, :, 0]

    def _turned(self, rate: np.ndarray, first: np.ndarray | None = None, own: bool = False) -> np.ndarray:
        """(n, 3, k) turns from the path of rates (n, 3, k) along it, from `first` (3, k) on; less the path's own turning
        where `own` says so."""
        from massprops.diagnosis.turn_kernel import turned

        first = np.zeros((3, rate.shape[2])) if first is None else first
        rate = np.ascontiguousarray(rate)
        return np.asarray(turned(self.path.t, self._answer, self.path.steps, rate, first, 1.0 if own else 0.0))

    @cached_property
    def _answer(self) -> np.ndarray:
        """(n, 3, 3) how the rate answers a turn from the path: I^-1 [R^T L]x."""
        return np.ascontiguousarray(self.inverse @ skew(self.momentum))
