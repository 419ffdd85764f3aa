"""Body rates from an attitude history, and attitude from rates, by local polynomials in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.quaternion import (
    chained,
    conjugate,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
    rotation_vector,
)
from massprops.estimators import free_path

SIZES = (5, 7, 9, 11, 13, 17, 21, 25, 31, 41, 51, 65, 81, 101)
LARGEST_SWEEP = 2.0
"""Rotation within a window [rad] that the rotation vector and a cubic can follow."""
WORSE = 1.15
"""A longer window is taken while its residuals are no larger than this times the least."""
SAMPLES = 60
LARGEST_STEP = 0.2
"""Rotation [rad] per Runge-Kutta step within a window."""
LARGEST_SQUARE = 25.0
"""Squared residual of a window, over the usual one, from which it is an outlier."""


@dataclass(frozen=True)
class LocalFit:
    """n epochs.

    Attributes:
        q: (n, 4) smoothed; w: (n, 3) body rates [rad/s]; NaN where the record is too thin.
        covariance: (n, 6, 6) of a small turn about body axes [rad] and of the rates [rad/s].
        window: epochs in each fit; scale: factor on the stated variance that the residuals asked for.
        good: (n,) samples that fit their neighbours.
        index: (n, L) samples in each fit; influence: (n, L, 6, 3) of a small turn of each about reference axes on the
        smoothed turn and rates, or None. sample_covariance: (n, 3, 3) of those turns, scaled; shared: (n, 6, s) errors
        that all samples have in common, of unit variance.
    """

    q: np.ndarray
    w: np.ndarray
    covariance: np.ndarray
    window: int
    scale: float
    good: np.ndarray
    index: np.ndarray | None = None
    influence: np.ndarray | None = None
    sample_covariance: np.ndarray | None = None
    shared: np.ndarray | None = None


def from_attitude(
    times: np.ndarray,
    q: np.ndarray,
    covariance: np.ndarray,
    shared: np.ndarray | None = None,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> LocalFit:
    """Smoothed attitude and body rates from cubic rotation vectors over the longest window that follows the motion.

    With `near`, an inertia and the rates of an earlier fit, the cubics follow the small difference from free rotation
    instead of the rotation itself, which takes away what a cubic cannot follow.

    Args:
        times: (n,) [s]; q: (n, 4) body to reference; covariance: (n, 3, 3) of a small turn about reference axes;
        shared: (n, 3, s) turns that all samples have in common, per unit error. near: (3, 3) and (n, 3).
    """
    n = len(times)
    if n < 4:
        nothing = np.full((n, 6, 6), np.nan)
        return LocalFit(q.copy(), np.full((n, 3), np.nan), nothing, n, 1.0, np.ones(n, bool))
    information, every = inverse_of(covariance), np.arange(n)

    def fit(rows: np.ndarray, size: int, use: np.ndarray, wanted: bool) -> tuple[np.ndarray, ...]:
        return _attitude_fit(times, q, information, rows, size, use, near, wanted)

    size = _best_size(lambda rows, L: fit(rows, L, np.ones(n, bool), False)[2:4], n, _sweep(q))
    (c, spread, _, freedom, _, influence), scale, use = _consistent(lambda use: fit(every, size, use, True), n)
    theta, slope = c[:, 0], c[:, 1]
    w = slope - 0.5 * np.cross(theta, slope)
    if near is not None:
        w = w + near[1]
    out = spread.copy()
    thin = freedom <= 0
    smooth = normalise(multiply(q, from_rotation_vector(theta)))
    smooth[thin], w[thin], out[thin] = np.nan, np.nan, np.nan
    index = _windows(times, every, size)[0]
    common = None if shared is None else np.einsum("nlxj,nljs->nxs", influence, shared[index], optimize=True)
    return LocalFit(
        q=smooth, w=w, covariance=out * scale, window=size, scale=scale, good=use, index=index, influence=influence,
        sample_covariance=covariance * scale, shared=common,
    )  # fmt: skip


def from_rates(times: np.ndarray, w: np.ndarray, sigma: float) -> LocalFit:
    """Smoothed body rates from local quadratics, and the attitude that they integrate to, from identity.

    The covariance of the turn is that of the integral's random walk since the first epoch.

    Args:
        times: (n,) [s]; w: (n, 3) measured [rad/s]; sigma: of one component.
    """
    n = len(times)
    every = np.arange(n)
    turned = float(np.sum(np.linalg.norm(w, axis=1)[:-1] * np.diff(times))) / max(n - 1, 1)
    size = _best_size(lambda rows, L: _rate_fit(times, w, sigma, rows, L, np.ones(n, bool))[2:4], n, turned)
    (c, spread, *_), scale, use = _consistent(lambda use: _rate_fit(times, w, sigma, every, size, use), n)
    smooth, slope = c[:, 0], c[:, 1]
    step = np.diff(times)[:, None]
    before, after = smooth[:-1], smooth[1:]
    turn = step / 2 * (before + after) + step**2 / 12 * (slope[:-1] - slope[1:])
    turn += step**2 / 12 * np.cross(before, after)
    out = np.zeros((n, 6, 6))
    walk = sigma**2 * np.median(np.diff(times)) * (times - times[0])
    out[:, :3, :3] = walk[:, None, None] * np.eye(3)
    out[:, 3:, 3:] = spread[:, None, None] * np.eye(3)
    return LocalFit(normalise(chained(turn)), smooth, out * scale, size, scale, use)


def _consistent(
    fit: Callable[[np.ndarray], tuple[np.ndarray, ...]], n: int
) -> tuple[tuple[np.ndarray, ...], float, np.ndarray]:
    """A fit to the samples (n,) that agree with it, the factor that its residuals ask for, and which samples these are."""
    use = np.ones(n, bool)
    for _ in range(3):
        fitted = fit(use)
        square, freedom, own_squares = fitted[2:5]
        ok = freedom > 0
        scale = float(np.median(square[ok] / freedom[ok])) if ok.any() else 1.0
        bad = own_squares > LARGEST_SQUARE * max(scale, 1e-12)
        if (bad == ~use).all():
            break
        use = ~bad
    return fitted, max(scale, 1e-6), use


def _sweep(q: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(rotation_vector(multiply(conjugate(q[:-1]), q[1:])), axis=1)))


def _best_size(fit: Callable[..., Any], n: int, sweep: float) -> int:
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
    x = tau / unit
    out = np.ones((*x.shape, degree + 1))
    for power in range(degree):
        out[..., power + 1] = out[..., power] * x
    return out


def _attitude_fit(
    times: np.ndarray,
    q: np.ndarray,
    information: np.ndarray,
    rows: np.ndarray,
    size: int,
    use: np.ndarray,
    near: tuple[np.ndarray, np.ndarray] | None,
    wanted: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (r, 4, 3), covariance of the first two (r, 6, 6), chi-square and freedom (r,), own square (r,),
    influence of each sample's turn about reference axes on the first two (r, L, 6, 3), where `wanted`.
    """
    index, close = _windows(times, rows, size)
    taken = close & use[index]
    relative = multiply(conjugate(q[rows])[:, None], q[index])
    if near is not None:
        free = _free(times[index] - times[rows][:, None], near[1][rows], near[0])
        relative = multiply(relative, conjugate(free))
    phi = rotation_vector(relative)
    R = rotation_matrix(q[rows])[:, None]
    weight = np.swapaxes(R, -1, -2) @ information[index] @ R
    weight = np.where(taken[..., None, None], weight, 0.0)
    unit = float(np.median(np.diff(times))) * max(size / 2, 1.0)
    degree = 3 if min(size, len(times)) >= 6 else 2
    T = _basis(times[index] - times[rows][:, None], unit, degree)
    d = degree + 1
    # products of many small matrices: several times quicker as matmul than as einsum
    r, L = taken.shape
    pairs = (T[..., :, None] * T[..., None, :]).reshape(r, L, d * d)
    blocks = (np.swapaxes(pairs, 1, 2) @ weight.reshape(r, L, 9)).reshape(r, d, d, 3, 3)
    normal = blocks.transpose(0, 1, 3, 2, 4).reshape(r, 3 * d, 3 * d)
    side = (np.swapaxes(T, 1, 2) @ (weight @ phi[..., None])[..., 0]).reshape(r, 3 * d)
    inverse = inverse_of(normal)
    c = (inverse @ side[..., None]).reshape(r, d, 3)
    error = phi - T @ c
    each = np.sum((weight @ error[..., None])[..., 0] * error, axis=-1)
    freedom = 3.0 * (taken.sum(axis=1) - d)
    c[:, 1] /= unit
    inverse = inverse.copy()
    inverse[:, 3:6] /= unit
    inverse[:, :, 3:6] /= unit
    whole = np.swapaxes(R[:, 0], -1, -2) @ information[rows] @ R[:, 0]
    own_squares = np.einsum("ri,rij,rj->r", c[:, 0], whole, c[:, 0])
    if not wanted:
        return c, inverse[:, :6, :6], each.sum(axis=1), freedom, own_squares, np.zeros(0)
    first = inverse[:, :6].reshape(r, 6, d, 3)
    first = np.concatenate([first[:, :, :1], first[:, :, 1:2] * unit, first[:, :, 2:]], axis=2)
    by_sample = (T @ first.transpose(0, 2, 1, 3).reshape(r, d, 18)).reshape(r, L, 6, 3)
    influence = by_sample @ weight @ np.swapaxes(R, -1, -2)
    return c, inverse[:, :6, :6], each.sum(axis=1), freedom, own_squares, influence


def _free(tau: np.ndarray, w: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Free rotation (r, L, 4) from rates w (r, 3) at time zero to times tau (r, L), which ascend through zero."""
    from massprops.core.compiling import compiled

    six = np.array(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], float)
    free_windows = compiled("free_windows", *free_path.COMPILED)
    return np.asarray(free_windows(np.ascontiguousarray(tau), np.ascontiguousarray(w, float), six, LARGEST_STEP))


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
    own_squares = np.sum(((w[rows] - c[:, 0]) / sigma) ** 2, axis=1)
    c[:, 1] /= unit
    return c, sigma**2 * inverse[:, 0, 0], square, 3.0 * (taken.sum(axis=1) - 3), own_squares
