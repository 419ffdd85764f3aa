"""The filter of volpe2017 as arrays in and out: what it starts from, its run, and the ratios in its inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.surroundings import Surroundings
from massprops.estimators.chaser_path import chaser_path
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


def range_filtered(
    start: RangeStart,
    times: np.ndarray,
    intrinsics: np.ndarray,
    uv: np.ndarray,
    sigma_px: float,
    ranges: np.ndarray,
    sigma_range: float,
    environment: Environment,
    turn_noise: float,
    push_noise: float,
    camera: np.ndarray | None = None,
    gate: float = GATE,
) -> RangeRun:
    """Runs the compiled filter over n epochs.

    Args:
        times: (n,) [s] since the environment's first timestamp; intrinsics: (4,); uv: (n, m, 2) of cam0, NaN where not
        seen; ranges: (n,) [m], NaN where none; turn_noise [rad^2/s^3], push_noise [m^2/s^3]; camera: (n, 4) attitude
        of cam0 (to inertial) where it is not the environment's; gate: squared sigmas.
    """
    from massprops.estimators.ranging.kernel import run

    path = chaser_path(environment, times)
    middle = np.zeros((max(len(times) - 1, 0), 3))
    if path.mu > 0:
        around = Surroundings(environment)
        middle = np.stack(np.broadcast_arrays(*around.position(0.5 * (times[1:] + times[:-1]))), axis=-1)
    y = np.concatenate([start.q, start.w, start.r, start.v]).astype(float)
    f, P, s = start.f.copy(), start.P.copy(), from_inertia(start.tensor)
    out, block, tally = run(
        np.ascontiguousarray(times, float),
        y,
        s,
        f,
        P,
        np.asarray(intrinsics, float),
        np.ascontiguousarray(uv, float),
        float(sigma_px) ** 2,
        np.ascontiguousarray(ranges, float),
        float(sigma_range) ** 2 if np.isfinite(sigma_range) else 1.0,
        np.ascontiguousarray(path.q if camera is None else camera, float),
        np.ascontiguousarray(path.place, float),
        np.ascontiguousarray(middle, float),
        float(path.mu),
        float(turn_noise),
        float(push_noise),
        float(gate),
    )
    return RangeRun(
        out[:, :4],
        out[:, 4:7],
        out[:, 7:10],
        out[:, 10:13],
        out[:, 13:],
        block,
        f,
        P,
        int(tally[0]),
        int(tally[1]),
        float(tally[2]) / max(float(tally[3]), 1.0),
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


__all__ = [
    "BASE",
    "RangeRun",
    "RangeStart",
    "inertia_covariance",
    "range_filtered",
    "ratio_jacobian",
    "ratios_over",
]
