"""Body rates from an attitude history, and attitude from rates, by local polynomials in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.quaternion import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
    rotation_vector,
)
from massprops.estimators.alignment import inverse_of

SIZES = (5, 7, 9, 11, 13, 17, 21, 25, 31, 41, 51, 65, 81, 101)
LARGEST_SWEEP = 2.0
"""Rotation within a window [rad] that the rotation vector and a cubic can follow."""
WORSE = 1.15
"""A longer window is taken while its residuals are no larger than this times the least."""
SAMPLES = 60
LARGEST_SQUARE = 25.0


@dataclass(frozen=True)
class LocalFit:
    """n epochs.

    Attributes:
        q: (n, 4) smoothed; w: (n, 3) body rates [rad/s]; NaN where the record is too thin.
        covariance: (n, 6, 6) of a small turn about body axes [rad] and of the rates [rad/s].
        window: epochs in each fit; scale: factor on the stated variance that the residuals asked for.
        good: (n,) samples that fit their neighbours.
    """

    q: np.ndarray
    w: np.ndarray
    covariance: np.ndarray
    window: int
    scale: float
    good: np.ndarray


def from_attitude(times: np.ndarray, q: np.ndarray, covariance: np.ndarray) -> LocalFit:
    """Smoothed attitude and body rates from cubic rotation vectors over the longest window that follows the motion.

    Args:
        times: (n,) [s]; q: (n, 4) body to reference; covariance: (n, 3, 3) of a small turn about reference axes.
    """
    n = len(times)
    if n < 4:
        nothing = np.full((n, 6, 6), np.nan)
        return LocalFit(q.copy(), np.full((n, 3), np.nan), nothing, n, 1.0, np.ones(n, bool))
    use = np.ones(n, bool)
    size = _best_size(times, lambda rows, L: _attitude_fit(times, q, covariance, rows, L, use)[2:4], n, _sweep(q))
    for _ in range(3):
        every = np.arange(n)
        c, spread, square, freedom, own = _attitude_fit(times, q, covariance, every, size, use)
        scale = _scale(square, freedom)
        bad = own > LARGEST_SQUARE * max(scale, 1e-12)
        if (bad == ~use).all():
            break
        use = ~bad
    theta, slope = c[:, 0], c[:, 1]
    w = slope - 0.5 * np.cross(theta, slope)
    out = np.zeros((n, 6, 6))
    out[:, :3, :3], out[:, :3, 3:] = spread[:, :3, :3], spread[:, :3, 3:6]
    out[:, 3:, :3], out[:, 3:, 3:] = spread[:, 3:6, :3], spread[:, 3:6, 3:6]
    thin = freedom <= 0
    smooth = normalise(multiply(q, from_rotation_vector(theta)))
    smooth[thin], w[thin], out[thin] = np.nan, np.nan, np.nan
    return LocalFit(smooth, w, out * max(scale, 1e-6), size, scale, use)


def from_rates(times: np.ndarray, w: np.ndarray, sigma: float) -> LocalFit:
    """Smoothed body rates from local quadratics, and the attitude that they integrate to, from identity.

    The covariance of the turn is that of the integral's random walk since the first epoch.

    Args:
        times: (n,) [s]; w: (n, 3) measured [rad/s]; sigma: of one component.
    """
    n = len(times)
    use = np.ones(n, bool)
    turned = float(np.sum(np.linalg.norm(w, axis=1)[:-1] * np.diff(times))) / max(n - 1, 1)
    size = _best_size(times, lambda rows, L: _rate_fit(times, w, sigma, rows, L, use)[2:4], n, turned)
    for _ in range(3):
        c, spread, square, freedom, own = _rate_fit(times, w, sigma, np.arange(n), size, use)
        scale = _scale(square, freedom)
        bad = own > LARGEST_SQUARE * max(scale, 1e-12)
        if (bad == ~use).all():
            break
        use = ~bad
    smooth, slope = c[:, 0], c[:, 1]
    step = np.diff(times)[:, None]
    before, after = smooth[:-1], smooth[1:]
    turn = step / 2 * (before + after) + step**2 / 12 * (slope[:-1] - slope[1:])
    turn += step**2 / 12 * np.cross(before, after)
    q = np.empty((n, 4))
    q[0] = [1.0, 0, 0, 0]
    for k, piece in enumerate(from_rotation_vector(turn)):
        q[k + 1] = normalise(multiply(q[k], piece))
    out = np.zeros((n, 6, 6))
    walk = sigma**2 * np.median(np.diff(times)) * (times - times[0])
    out[:, :3, :3] = walk[:, None, None] * np.eye(3)
    out[:, 3:, 3:] = spread[:, None, None] * np.eye(3)
    return LocalFit(q, smooth, out * max(scale, 1e-6), size, scale, use)


def _sweep(q: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(rotation_vector(multiply(conjugate(q[:-1]), q[1:])), axis=1)))


def _best_size(times: np.ndarray, fit, n: int, sweep: float) -> int:  # type: ignore[no-untyped-def]
    rows = np.unique(np.linspace(0, n - 1, min(n, SAMPLES)).astype(int))
    best, least = min(n, SIZES[0]), np.inf
    for size in SIZES:
        if size > n or (size > SIZES[1] and size * sweep > LARGEST_SWEEP):
            break
        square, freedom = fit(rows, size)
        ok = freedom > 0
        if not ok.any():
            continue
        level = float(np.sum(np.minimum(square[ok], np.quantile(square[ok], 0.9))) / np.sum(freedom[ok]))
        if level <= WORSE * least or size <= SIZES[1]:
            best = size
        least = min(least, level) if size > SIZES[0] else least
    return best


def _windows(times: np.ndarray, rows: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours (r, L) of the rows, and which of them are near enough in time."""
    n = len(times)
    first = np.clip(rows - size // 2, 0, max(n - size, 0))
    index = first[:, None] + np.arange(min(size, n))
    away = np.abs(times[index] - times[rows][:, None])
    step = np.median(np.diff(times))
    return index, away <= 1.5 * step * size


def _basis(tau: np.ndarray, unit: float, degree: int) -> np.ndarray:
    return (tau / unit)[..., None] ** np.arange(degree + 1)


def _attitude_fit(
    times: np.ndarray, q: np.ndarray, covariance: np.ndarray, rows: np.ndarray, size: int, use: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (r, 4, 3), covariance of the first two (r, 6, 6), chi-square and freedom (r,), own square (r,)."""
    index, near = _windows(times, rows, size)
    taken = near & use[index]
    phi = rotation_vector(multiply(conjugate(q[rows])[:, None], q[index]))
    R = rotation_matrix(q[rows])[:, None]
    weight = np.swapaxes(R, -1, -2) @ inverse_of(covariance)[index] @ R
    weight = np.where(taken[..., None, None], weight, 0.0)
    unit = float(np.median(np.diff(times))) * max(size / 2, 1.0)
    degree = 3 if min(size, len(times)) >= 6 else 2
    T = _basis(times[index] - times[rows][:, None], unit, degree)
    d = degree + 1
    normal = np.einsum("rla,rlb,rlij->raibj", T, T, weight, optimize=True).reshape(len(rows), 3 * d, 3 * d)
    side = np.einsum("rla,rlij,rlj->rai", T, weight, phi, optimize=True).reshape(len(rows), 3 * d)
    inverse = inverse_of(normal)
    c = np.einsum("rij,rj->ri", inverse, side).reshape(len(rows), d, 3)
    error = phi - np.einsum("rla,rai->rli", T, c)
    each = np.einsum("rli,rlij,rlj->rl", error, weight, error)
    freedom = 3.0 * (taken.sum(axis=1) - d)
    c[:, 1] /= unit
    inverse = inverse.copy()
    inverse[:, 3:6] /= unit
    inverse[:, :, 3:6] /= unit
    whole = np.swapaxes(R[:, 0], -1, -2) @ inverse_of(covariance)[rows] @ R[:, 0]
    own = np.einsum("ri,rij,rj->r", c[:, 0], whole, c[:, 0])
    return c, inverse[:, :6, :6], each.sum(axis=1), freedom, own


def _rate_fit(
    times: np.ndarray, w: np.ndarray, sigma: float, rows: np.ndarray, size: int, use: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (r, 3, 3), variance of the first (r,), chi-square and freedom (r,), own square (r,)."""
    index, near = _windows(times, rows, size)
    taken = (near & use[index]).astype(float)
    unit = float(np.median(np.diff(times))) * max(size / 2, 1.0)
    T = _basis(times[index] - times[rows][:, None], unit, 2)
    inverse = inverse_of(np.einsum("rl,rla,rlb->rab", taken, T, T))
    c = np.einsum("rab,rl,rlb,rli->rai", inverse, taken, T, w[index], optimize=True)
    error = (w[index] - np.einsum("rla,rai->rli", T, c)) / sigma
    square = np.einsum("rl,rli->r", taken, error**2)
    own = np.sum(((w[rows] - c[:, 0]) / sigma) ** 2, axis=1)
    c[:, 1] /= unit
    return c, sigma**2 * inverse[:, 0, 0], square, 3.0 * (taken.sum(axis=1) - 3), own


def _scale(square: np.ndarray, freedom: np.ndarray) -> float:
    ok = freedom > 0
    return float(np.median(square[ok] / freedom[ok])) if ok.any() else 1.0
