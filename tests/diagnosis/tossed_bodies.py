"""Attitudes of a body that is tossed and pushed once in its flight, as a camera at 150 Hz would see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise
from massprops.sequence.data import AttitudeSeries

RATE = 150.0
"""Attitudes a second."""
SIGMA = 8e-4
"""Of an attitude, about each axis [rad]."""


@dataclass(frozen=True, kw_only=True)
class Toss:
    """One flight.

    Attributes:
        inertia: (3, 3), trace 3; rate: (3,) at the start; push: (3,) torque over the mean moment, body axes, from `begins` on for
            `lasts`; seconds: of flight.
    """

    inertia: np.ndarray
    rate: np.ndarray
    push: np.ndarray
    begins: float
    lasts: float
    seconds: float

    @property
    def kick(self) -> np.ndarray:
        """(3,) momentum that the push adds, over the mean moment, body axes [rad/s]."""
        return self.push * self.lasts


def tossed(toss: Toss, seed: int, noise: float = SIGMA) -> tuple[AttitudeSeries, np.ndarray]:
    """Attitudes of a flight, and the change of its rate over the push."""

    def slope(t, y):
        q, w = y[:4], y[4:]
        torque = toss.push * (toss.begins < t < toss.begins + toss.lasts)
        turning = 0.5 * multiply(q, np.concatenate([[0.0], w]))
        return np.concatenate([turning, np.linalg.solve(toss.inertia, torque - np.cross(w, toss.inertia @ w))])

    times = np.arange(round(toss.seconds * RATE)) / RATE
    start = np.concatenate([[1.0, 0.0, 0.0, 0.0], toss.rate])
    found = solve_ivp(slope, (0.0, times[-1]), start, dense_output=True, rtol=1e-9, atol=1e-10, max_step=0.001)
    y = found.sol(times).T
    turned = noise * np.random.default_rng(seed).standard_normal((len(times), 3))
    q = normalise(multiply(normalise(y[:, :4]), from_rotation_vector(turned)))
    change = found.sol(toss.begins + toss.lasts)[4:] - found.sol(toss.begins)[4:]
    return AttitudeSeries(np.round(times * 1e9).astype(np.int64), q, np.full(len(times), SIGMA)), change


def drawn(seed: int) -> Toss:
    """A toss of 0.3 s by a seed: second moments of mass within 1 to 6, turning at 3 to 6 rad/s, a push of 10 to 40 ms about
    0.1 s that adds 3 to 8 rad/s."""
    rng = np.random.default_rng([seed, 90])
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    second = np.exp(rng.uniform(0.0, np.log(6.0), 3))
    P = 1.5 * (turn * second / second.sum()) @ turn.T

    def any_way(size: float) -> np.ndarray:
        v = rng.standard_normal(3)
        return size * v / np.linalg.norm(v)

    lasts = rng.uniform(0.01, 0.04)
    return Toss(
        inertia=1.5 * np.eye(3) - P, rate=any_way(rng.uniform(3.0, 6.0)), push=any_way(rng.uniform(3.0, 8.0) / lasts),
        begins=0.1 + rng.uniform(-0.02, 0.02) - 0.5 * lasts, lasts=lasts, seconds=0.3,
    )  # fmt: skip
