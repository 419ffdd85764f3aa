"""The filter of volpe2017 as arrays in and out: what it starts from, its run, and the ratios in its inertia."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics.surroundings import Surroundings
from massprops.estimators.chaser_path import ChaserPath, chaser_path
from massprops.estimators.inertia_parameters import from_inertia, inertia
from massprops.estimators.result import ratios
from massprops.sequence.data import Environment

BASE = 17
"""Errors before the features': attitude 3, rate 3, inertia 5, position 3, velocity 3."""
GATE = 20.0
"""Squared sigmas that one in a hundred thousand good measurements exceeds."""


@dataclass(frozen=True)
class RangeStart:
    """State and covariance at the first epoch. q (4,) body to inertial; w (3,) body axes [rad/s]; r, v (3,) inertial
    [m, m/s]; tensor (3, 3) inertia in body axes; f (m, 3) body axes [m]; P (17 + 3 m, 17 + 3 m), the inertia's part by
    the parameters of `inertia_parameters`' general form."""

    q: np.ndarray
    w: np.ndarray
    tensor: np.ndarray
    r: np.ndarray
    v: np.ndarray
    f: np.ndarray
    P: np.ndarray


@dataclass(frozen=True)
class RangeRun:
    """n epochs. q (n, 4), w, r, v (n, 3), s (n, 5) inertia parameters, block (n, 17, 17) covariance; f (m, 3), P at the
    end; used, refused: numbers measured; innovation: mean squared in units of its covariance."""

    q: np.ndarray
    w: np.ndarray
    r: np.ndarray
    v: np.ndarray
    s: np.ndarray
    block: np.ndarray
    f: np.ndarray
    P: np.ndarray
    used: int
    refused: int
    innovation: float


@dataclass(frozen=True)
class RangeData:
    """What one camera and a range sensor measured over n epochs.

    Attributes:
        times: (n,) [s] since the environment's first timestamp; intrinsics: (4,).
        uv: (n, m, 2) of cam0, NaN where not seen; sigma_px. ranges: (n,) [m], NaN where none; sigma_range [m].
        camera: (n, 4) attitude of cam0 (to inertial) where it is not the environment's.
    """

    times: np.ndarray
    intrinsics: np.ndarray
    uv: np.ndarray
    sigma_px: float
    ranges: np.ndarray
    sigma_range: float
    environment: Environment
    camera: np.ndarray | None = None

    def first(self, n: int) -> RangeData:
        """The first n epochs."""
        camera = None if self.camera is None else self.camera[:n]
        return replace(self, times=self.times[:n], uv=self.uv[:n], ranges=self.ranges[:n], camera=camera)

    def leader(self) -> tuple[ChaserPath, np.ndarray]:
        """The chaser at the epochs, its axes those of cam0, and where it is half-way between them (n - 1, 3) [m]."""
        path = chaser_path(self.environment, self.times)
        middle = np.zeros((max(len(self.times) - 1, 0), 3))
        if path.mu > 0:
            around = Surroundings(self.environment)
            middle = np.stack(np.broadcast_arrays(*around.position(0.5 * (self.times[1:] + self.times[:-1]))), axis=-1)
        return path if self.camera is None else replace(path, q=self.camera), middle


def range_filtered(
    start: RangeStart, data: RangeData, turn_noise: float, push_noise: float, gate: float = GATE
) -> RangeRun:
    """Runs the compiled filter.

    Args:
        turn_noise [rad^2/s^3]; push_noise [m^2/s^3]; gate: squared sigmas.
    """
    from massprops.estimators.ranging.kernel import Moving, Rule, run

    path, middle = data.leader()
    y = np.concatenate([start.q, start.w, start.r, start.v]).astype(float)
    P = start.P.copy()
    state = Moving(y, from_inertia(start.tensor), start.f.copy(), P, np.zeros_like(P))
    rule = Rule(
        lens=np.asarray(data.intrinsics, float),
        pixel_variance=float(data.sigma_px) ** 2,
        range_variance=float(data.sigma_range) ** 2 if np.isfinite(data.sigma_range) else 1.0,
        gate=float(gate),
        mu=float(path.mu),
        turn_noise=float(turn_noise),
        push_noise=float(push_noise),
    )
    arrays = (data.times, data.uv, data.ranges, path.q, path.place, middle)
    out, block, tally = run(state, *(np.ascontiguousarray(x, float) for x in arrays), rule)
    return RangeRun(
        q=out[:, :4],
        w=out[:, 4:7],
        r=out[:, 7:10],
        v=out[:, 10:13],
        s=out[:, 13:],
        block=block,
        f=state.f,
        P=P,
        used=int(tally[0]),
        refused=int(tally[1]),
        innovation=float(tally[2]) / max(float(tally[3]), 1.0),
    )


def ratio_jacobian(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of k1, k2 (..., 2, 5) and of a turn of the principal axes about themselves (..., 3, 5) by parameters.

    First-order perturbation: with axes V and moments d, d(ln d_i) = (V^T dI V)_ii / d_i, and the turn about axis k is
    (V^T dI V)_ij / (d_i - d_j) for (i, j, k) in order.
    """
    s = np.asarray(s, float)
    tensor = inertia(s)
    moments, V = np.linalg.eigh(tensor)
    V = V * np.where(np.linalg.det(V) < 0, -1.0, 1.0)[..., None, None]
    step = 1e-6
    columns, turns = [], []
    for a in range(5):
        e = np.zeros(5)
        e[a] = step
        change = np.swapaxes(V, -1, -2) @ ((inertia(s + e) - inertia(s - e)) / (2 * step)) @ V
        log = np.einsum("...ii->...i", change) / moments
        columns.append(np.stack([log[..., 0] - log[..., 1], log[..., 1] - log[..., 2]], axis=-1))
        gap = [
            np.where(np.abs(g) < 1e-9, -1e-9, g)
            for g in (moments[..., i] - moments[..., j] for i, j in ((1, 2), (2, 0), (0, 1)))
        ]
        # V exp([theta]) turns the diagonal d into off-diagonals theta_k (d_i - d_j), (i, j, k) in order
        turns.append(
            np.stack([change[..., i, j] / g for (i, j), g in zip(((1, 2), (2, 0), (0, 1)), gap, strict=True)], axis=-1)
        )
    return np.stack(columns, axis=-1), np.stack(turns, axis=-1)


def inertia_covariance(tensor: np.ndarray, k_sigma: np.ndarray, axes_sigma: np.ndarray) -> np.ndarray:
    """(5, 5) covariance of the parameters from sigmas of k1, k2 (2,) and of turns of the principal axes (3,) [rad]."""
    by_k, by_turn = ratio_jacobian(from_inertia(tensor))
    back = np.linalg.inv(np.concatenate([by_k, by_turn]))
    spread = np.concatenate([np.broadcast_to(k_sigma, 2), np.broadcast_to(axes_sigma, 3)]) ** 2
    covariance: np.ndarray = (back * spread) @ back.T
    return covariance


def ratios_over(s: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k1, k2 (n, 2) and their covariance (n, 2, 2) over a run."""
    k, _ = ratios(inertia(s))
    by_k, _ = ratio_jacobian(s)
    return k, by_k @ block[:, 6:11, 6:11] @ np.swapaxes(by_k, -1, -2)
