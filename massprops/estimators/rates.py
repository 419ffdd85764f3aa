"""Body rates from an attitude history, and attitude from rates, by local polynomials in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.kernels import euler_acceleration, quaternion_rate
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
LARGEST_STEP = 0.2
"""Rotation [rad] per Runge-Kutta step within a window."""
LARGEST_SQUARE = 25.0


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
    use = np.ones(n, bool)
    size = _best_size(times, lambda rows, L: _attitude_fit(times, q, covariance, rows, L, use, near)[2:4], n, _sweep(q))
    for _ in range(3):
        every = np.arange(n)
        c, spread, square, freedom, own, influence = _attitude_fit(times, q, covariance, every, size, use, near)
        scale = _scale(square, freedom)
        bad = own > LARGEST_SQUARE * max(scale, 1e-12)
        if (bad == ~use).all():
            break
        use = ~bad
    theta, slope = c[:, 0], c[:, 1]
    w = slope - 0.5 * np.cross(theta, slope)
    if near is not None:
        w = w + near[1]
    out = np.zeros((n, 6, 6))
    out[:, :3, :3], out[:, :3, 3:] = spread[:, :3, :3], spread[:, :3, 3:6]
    out[:, 3:, :3], out[:, 3:, 3:] = spread[:, 3:6, :3], spread[:, 3:6, 3:6]
    thin = freedom <= 0
    smooth = normalise(multiply(q, from_rotation_vector(theta)))
    smooth[thin], w[thin], out[thin] = np.nan, np.nan, np.nan
    scale = max(scale, 1e-6)
    index = _windows(times, every, size)[0]
    common = None if shared is None else np.einsum("nlxj,nljs->nxs", influence, shared[index], optimize=True)
    return LocalFit(smooth, w, out * scale, size, scale, use, index, influence, covariance * scale, common)


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
    times: np.ndarray,
    q: np.ndarray,
    covariance: np.ndarray,
    rows: np.ndarray,
    size: int,
    use: np.ndarray,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (r, 4, 3), covariance of the first two (r, 6, 6), chi-square and freedom (r,), own square (r,),
    influence of each sample's turn about reference axes on the first two (r, L, 6, 3).
    """
    index, close = _windows(times, rows, size)
    taken = close & use[index]
    relative = multiply(conjugate(q[rows])[:, None], q[index])
    if near is not None:
        free = _free(times[index] - times[rows][:, None], near[1][rows], near[0])
        relative = multiply(relative, conjugate(free))
    phi = rotation_vector(relative)
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
    first = inverse[:, :6].reshape(len(rows), 6, d, 3)
    first = np.concatenate([first[:, :, :1], first[:, :, 1:2] * unit, first[:, :, 2:]], axis=2)
    influence = np.einsum("rxai,rla,rlij->rlxj", first, T, weight, optimize=True) @ np.swapaxes(R, -1, -2)
    return c, inverse[:, :6, :6], each.sum(axis=1), freedom, own, influence


def _free(tau: np.ndarray, w: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Free rotation (r, L, 4) from rates w (r, 3) at time zero to times tau (r, L), which ascend through zero."""
    a, b, c, d, e, f = (float(x) for x in inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    out = np.zeros((*tau.shape, 4))

    def slope(y: np.ndarray) -> np.ndarray:
        turn = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
        return np.stack([*turn, *euler_acceleration(a, b, c, d, e, f, y[4], y[5], y[6], 0.0, 0.0, 0.0)])

    middle = np.argmin(np.abs(tau), axis=1)
    rows = np.arange(len(tau))
    speed = float(np.nanmax(np.linalg.norm(w, axis=1)))
    for side in (1, -1):
        y = np.concatenate([np.tile([[1.0], [0], [0], [0]], len(w)), w.T])
        before = np.zeros(len(w))
        for away in range(tau.shape[1]):
            at = middle + side * away
            inside = (at >= 0) & (at < tau.shape[1])
            if not inside.any():
                break
            now = np.where(inside, tau[rows, np.clip(at, 0, tau.shape[1] - 1)], before)
            steps = max(1, int(np.ceil(speed * float(np.abs(now - before).max()) / LARGEST_STEP)))
            h = (now - before) / steps
            for _ in range(steps):
                one = slope(y)
                two = slope(y + h / 2 * one)
                three = slope(y + h / 2 * two)
                y = y + h / 6 * (one + 2 * two + 2 * three + slope(y + h * three))
            out[rows[inside], at[inside]] = normalise(y[:4, inside].T)
            before = now
    return out


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
