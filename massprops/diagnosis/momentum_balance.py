"""The balance of angular momentum along a measured path: linear in inertia, momentum and nearly every effect.

A body with attitude R (body to inertial), rate w in body axes, inertia I and momentum h of what turns inside obeys

    R (I w + h) = L0 + integral of R torque dt.

Solved for the rate, every row carries the noise of one measurement and no other:

    w = I^-1 (R^T L - h),

so the noise of rates stands in no column, as it does where measured rates are multiplied by the inertia, which draws the
estimate toward bodies along whose axes noise is explained by itself. What is left of errors in variables:

- A gyroscope's path is its own rates integrated. White noise of the rates turns it by sigma sqrt(dt t), some 1e-4 rad in
  a throw, and is left out. Scale and misalignment turn it by a part of the whole angle: they have columns.
- A path through attitudes is off by a turn phi, which is the row itself: phi' = w - u - u x phi, u the path's rate, and
  w answers it by I^-1 (R^T L) x phi. Columns of w and phi come together from one march along the path; solving again
  along the path that was found is Gauss and Newton's method for the likelihood of the attitudes.

The inertia enters by the logarithm of its second moments of mass, so that every step leads to a body that can be; about
the present guess I_c a change dI answers with -I_c^-1 dI w_c, w_c the rate predicted, and a few passes settle it.

Units: momenta over the mean moment, trace I = 3, so torques in rad/s^2 and momenta in rad/s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.diagnosis.motion_path import MotionPath

INERTIA = 5
"""Columns of the inertia: the ways one of trace 3 can change."""


def traceless() -> np.ndarray:
    """(5, 3, 3) orthonormal symmetric matrices without trace."""
    r = np.sqrt(0.5)
    E = np.zeros((INERTIA, 3, 3))
    E[0] = np.diag([r, -r, 0.0])
    E[1] = np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0)
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        E[2 + k, i, j] = E[2 + k, j, i] = r
    return E


def inertia_of(shape: np.ndarray) -> np.ndarray:
    """(3, 3) inertia, trace 3, of the logarithm (5,) of its second moments of mass: any numbers are a body's.

    I = tr(P) - P with the second moments P = exp(sum shape_k E_k), scaled; zeros are a ball.
    """
    value, vector = np.linalg.eigh(np.einsum("a,aij->ij", shape, traceless()))
    P = 1.5 * np.exp(value - value.max())
    return np.asarray(1.5 * np.eye(3) - (vector * P / np.sum(np.exp(value - value.max()))) @ vector.T)


def shape_of(inertia: np.ndarray, least: float = 0.002) -> np.ndarray:
    """(5,) logarithm of the second moments of an inertia (3, 3), none of them below a share `least` of their sum."""
    value, vector = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    log = np.log(np.maximum(value / np.sum(np.maximum(value, 0.0)), least))
    return np.asarray(np.einsum("aij,ij->a", traceless(), (vector * (log - log.mean())) @ vector.T))


def inertia_slopes(shape: np.ndarray) -> np.ndarray:
    """(5, 3, 3) derivatives of `inertia_of` (Daleckii and Krein's formula for a function of a matrix)."""
    value, vector = np.linalg.eigh(np.einsum("a,aij->ij", shape, traceless()))
    e = np.exp(value - value.max())
    apart = value[:, None] - value
    alike = np.abs(apart) < 1e-7
    ratio = np.where(alike, 0.5 * (e[:, None] + e), (e[:, None] - e) / np.where(alike, 1.0, apart))
    inside = np.einsum("ji,ajk,kl->ail", vector, traceless(), vector) * ratio
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
    """

    at: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    rates: bool

    @property
    def spread(self) -> np.ndarray:
        """(3 m,) 1-sigma of each number measured."""
        return np.repeat(self.sigma, 3) if self.sigma.ndim == 1 else self.sigma.reshape(-1)


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

    @property
    def inertia(self) -> np.ndarray:
        """(3, 3), trace 3."""
        return inertia_of(self.shape)

    @property
    def base_count(self) -> int:
        """Columns that every hypothesis has: inertia, momentum at the start, and with attitudes the turn at the start."""
        return INERTIA + (3 if self.rows.rates else 6)

    def constant(self, momentum: np.ndarray) -> np.ndarray:
        """(m, 3) what the rows hold when the momentum at the start is `momentum` (3,), inertial axes, and every other
        unknown zero: near the rows, so that no large numbers stand against each other."""
        rate = np.linalg.solve(self.inertia, np.swapaxes(self.path.R, 1, 2) @ momentum[:, None])
        if self.rows.rates:
            return np.asarray(rate[self.rows.at, :, 0])
        return np.asarray(self._turned(rate, own=True)[self.rows.at, :, 0])

    def free(self) -> np.ndarray:
        """(n, 3, 8) rate along the path itself of a unit of each of the inertia's shape and of the momentum at the start."""
        inverse = np.linalg.inv(self.inertia)
        by_shape = -np.einsum("ij,ajk,nk->nia", inverse, inertia_slopes(self.shape), self.rate)
        return np.concatenate([by_shape, inverse @ np.swapaxes(self.path.R, 1, 2)], axis=2)

    def base(self) -> np.ndarray:
        """(m, 3, `base_count`) columns of `free`, and with attitudes of the turn at the start."""
        out = self.response(self.free())
        if self.rows.rates:
            return out
        none = np.zeros((len(self.path.t), 3, 3))
        return np.concatenate([out, self._turned(none, np.eye(3))[self.rows.at]], axis=2)

    def scale(self) -> np.ndarray:
        """(m, 3, 9) columns of a gyroscope's scale and misalignment S: it shows (1 + S) w, and the path that was
        integrated from it is turned by as much."""
        shown = np.einsum("ij,nk->nijk", np.eye(3), self.rate).reshape(len(self.rate), 3, 9)
        R = self.path.R
        turn = -np.swapaxes(R, 1, 2) @ integral(self.path.t, R @ shown)
        return np.asarray((shown + self._answer() @ turn)[self.rows.at])

    def columns(self, forcing: Forcing) -> np.ndarray:
        """(m, 3, k) response of the rows to a unit of each unknown."""
        return self.response(self.forced(forcing))

    def forced(self, forcing: Forcing) -> np.ndarray:
        """(n, 3, k) rate along the path itself of a unit of each unknown."""
        total = np.zeros((len(self.path.t), 3, forcing.count))
        if forcing.momentum is not None:
            total += np.swapaxes(self.path.R, 1, 2) @ forcing.momentum
        if forcing.internal is not None:
            total -= forcing.internal
        out = np.linalg.inv(self.inertia) @ total
        return np.asarray(out if forcing.rate is None else out + forcing.rate)

    def response(self, rate: np.ndarray) -> np.ndarray:
        """(m, 3, k) rows of a change of the rate (n, 3, k)."""
        return np.asarray((rate if self.rows.rates else self._turned(rate))[self.rows.at])

    def motion(self, rate: np.ndarray, turn: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Rate (n, 3) and turn (n, 3) from the path when the balance gives this rate (n, 3) along the path itself, and
        `turn` (3,) at the start."""
        if self.rows.rates:
            return rate, np.zeros_like(rate)
        first = np.zeros((3, 1)) if turn is None else turn[:, None]
        phi = self._turned(rate[:, :, None], first, own=True)
        return rate + (self._answer() @ phi)[:, :, 0], phi[:, :, 0]

    def _turned(self, rate: np.ndarray, first: np.ndarray | None = None, own: bool = False) -> np.ndarray:
        """(n, 3, k) turns from the path of rates (n, 3, k) along it, from `first` (3, k) on; less the path's own turning
        where `own` says so."""
        first = np.zeros((3, rate.shape[2])) if first is None else first
        steps = self.path.steps
        return _march(self.path.t, self._answer(), steps, rate, first, steps if own else np.zeros_like(steps))

    def _answer(self) -> np.ndarray:
        """(n, 3, 3) how the rate answers a turn from the path: I^-1 [R^T L]x."""
        return np.asarray(np.linalg.inv(self.inertia) @ skew(self.momentum))


def skew(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3) with skew(v) x = v x x."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def _march(
    t: np.ndarray, answer: np.ndarray, steps: np.ndarray, rate: np.ndarray, first: np.ndarray, less: np.ndarray
) -> np.ndarray:
    """(n, 3, k) with phi' = (answer - [u]x) phi + rate - less from `first` (3, k), by the trapezoid.

    Args:
        steps, less: (n - 1, 3) constant from each point to the next: the path's own rate u, and what is taken off.
    """
    h = np.diff(t)[:, None, None]
    u = skew(steps)
    left = np.linalg.inv(np.eye(3) - 0.5 * h * (answer[1:] - u))
    step = left @ (np.eye(3) + 0.5 * h * (answer[:-1] - u))
    push = left @ (0.5 * h * (rate[1:] + rate[:-1]) - h * less[:, :, None])
    return _recursion(step, push, first)


def _recursion(step: np.ndarray, push: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(n + 1, 3, k) with x_0 = first (3, k), x_i+1 = step_i x_i + push_i; step (n, 3, 3), push (n, 3, k).

    All stretches of about sqrt(n) steps are done side by side, each as a linear map of where it begins.
    """
    n, k = len(push), push.shape[2]
    length = max(1, int(np.sqrt(n)))
    count = -(-n // length)
    spare = count * length - n
    steps = np.concatenate([step, np.broadcast_to(np.eye(3), (spare, 3, 3))]).reshape(count, length, 3, 3)
    pushes = np.concatenate([push, np.zeros((spare, 3, k))]).reshape(count, length, 3, k)
    carried, added = np.empty_like(steps), np.empty_like(pushes)
    carried[:, 0], added[:, 0] = steps[:, 0], pushes[:, 0]
    for i in range(1, length):
        carried[:, i] = steps[:, i] @ carried[:, i - 1]
        added[:, i] = steps[:, i] @ added[:, i - 1] + pushes[:, i]
    begins = np.empty((count, 3, k))
    begins[0] = first
    for j in range(1, count):
        begins[j] = carried[j - 1, -1] @ begins[j - 1] + added[j - 1, -1]
    out = (carried @ begins[:, None] + added).reshape(count * length, 3, k)[:n]
    return np.concatenate([first[None], out])
