"""First guesses of the two fundamental frequencies of a tumbling motion, from the spectrum of its measurements.

kabir2025 Algorithm 1 takes the tallest bins of a Fourier transform as periods. Three things are mended here. The mean is
removed. Lines are located between bins (matching pursuit with a refined peak), so that a period is not limited to T/m.
Candidates include differences of lines: the polhode frequency itself is often absent and shows only as the spacing of others.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from massprops.estimators.gp.kernel import feature_jacobian, features, lattice, waves

PAD = 8
"""Zero padding of the transform: a peak is located to a small part of a bin."""
LINES, TRIAL_ORDER = 10, 2
"""Lines sought in a spectrum, and order of the lattice with which pairs of frequencies are tried."""


def spectral_lines(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The `LINES` strongest lines common to all outputs, strongest first.

    Args:
        t: (n,) times [s], in order; gaps are allowed.
        y: (n, d) measurements.

    Returns:
        frequencies (LINES,) [Hz] and their rms amplitudes (LINES,).
    """
    span = t[-1] - t[0]
    step = float(np.median(np.diff(t)))
    grid = np.round((t - t[0]) / step).astype(int)
    size = 1 << int(np.ceil(np.log2((grid[-1] + 1) * PAD)))
    residual = y - y.mean(axis=0)
    frequencies: list[float] = []
    for _ in range(LINES):
        series = np.zeros((grid[-1] + 1, y.shape[1]))
        series[grid] = residual
        power = np.sum(np.abs(np.fft.rfft(series, size, axis=0)) ** 2, axis=1)
        frequency = np.fft.rfftfreq(size, step)
        power[frequency < 0.5 / span] = 0.0
        frequencies.append(float(frequency[np.argmax(power)]))
        lines = _sharpen(t, y, np.array(frequencies))
        frequencies = list(lines)
        basis = waves(t, lines)
        residual = y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
    basis = waves(t, np.array(frequencies))
    c = np.linalg.lstsq(basis, y, rcond=None)[0]
    m = len(frequencies)
    amplitude = np.sqrt(np.sum(c[1 : m + 1] ** 2 + c[m + 1 :] ** 2, axis=1))
    order = np.argsort(-amplitude)
    return np.array(frequencies)[order], amplitude[order]


def candidate_pairs(t: np.ndarray, y: np.ndarray, keep: int = 3) -> list[np.ndarray]:
    """Pairs of fundamental frequencies, best first by the Bayesian information criterion of a small lattice.

    Args:
        t: (n,) times [s].
        y: (n, d) measurements.
        keep: pairs returned.

    Returns:
        list of (2,) frequencies [Hz].
    """
    lines, amplitude = spectral_lines(t, y)
    span = t[-1] - t[0]
    strong = lines[amplitude > 1e-3 * amplitude[0]][:8]
    pool = list(strong)
    for a, b in combinations(strong, 2):
        pool += [abs(a - b), (a + b) / 2.0, abs(a - b) / 2.0]
    pool = [f for f in pool if f > 0.6 / span]
    unique: list[float] = []
    for f in pool:
        if all(abs(f - g) > 0.15 / span for g in unique):
            unique.append(f)
    trials = []
    orders = lattice(TRIAL_ORDER)
    thin = slice(None, None, max(1, len(t) // 400))
    for f in combinations(sorted(unique[:14]), 2):
        phi = features(t[thin], orders, np.array(f))
        gram = phi.T @ phi + 1e-6 * len(phi) * np.eye(phi.shape[1])
        b = phi.T @ y[thin]
        residual = np.sum(y[thin] ** 2) - np.sum(b * np.linalg.solve(gram, b))
        trials.append((residual, f))
    trials.sort(key=lambda item: item[0])
    refined = [_refine_pair(t, y, np.array(f), orders) for _, f in trials[: 3 * keep]]
    refined.sort(key=lambda item: item[0])
    out: list[np.ndarray] = []
    for _, f in refined:
        if all(np.max(np.abs(np.sort(f) - np.sort(g))) > 0.1 / span for g in out):
            out.append(f)
    return out[:keep]


def _refine_pair(t: np.ndarray, y: np.ndarray, f: np.ndarray, orders: np.ndarray) -> tuple[float, np.ndarray]:
    best, best_f, width = np.inf, f, 0.3 / (t[-1] - t[0])
    for _ in range(6):
        residual, move, _ = frequency_step(t, y, orders, f, np.full(2 * len(orders) - 1, 1e-6 * len(t)))
        if residual < best:
            best, best_f = residual, f
        f = f + np.clip(move, -width, width)
    return best, best_f


def frequency_step(
    t: np.ndarray, y: np.ndarray, orders: np.ndarray, f: np.ndarray, ridge: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """One Gauss-Newton step of the frequencies with the lines' amplitudes projected out.

    Args:
        t: (n,) [s].
        y: (n, d).
        orders: (m, 2).
        f: (2,) [Hz].
        ridge: (2m - 1,) or (2m - 1, d) prior precision of the amplitudes in units of the noise's precision.

    Returns:
        penalised residual sum of squares, step (2,) [Hz], and information (2, 2) of f for unit noise variance.
    """
    phi = features(t, orders, f)
    slopes = feature_jacobian(phi, t, orders)
    ridge = ridge if ridge.ndim == 2 else ridge[:, None]
    ridge = np.broadcast_to(ridge, (phi.shape[1], y.shape[1]))
    gram = phi.T @ phi
    residual, information, gradient = 0.0, np.zeros((2, 2)), np.zeros(2)
    shared = bool(np.all(ridge == ridge[:, :1]))
    solve = None
    for d in range(y.shape[1]):
        if solve is None or not shared:
            solve = _solver(gram, ridge[:, d])
        c = solve(phi.T @ y[:, d])
        e = y[:, d] - phi @ c
        residual += float(e @ e + np.sum(ridge[:, d] * c**2))
        j = np.stack([s @ c for s in slopes], axis=1)
        cross = phi.T @ j
        information += j.T @ j - cross.T @ solve(cross)
        gradient += j.T @ e
    return residual, np.linalg.lstsq(information, gradient, rcond=None)[0], information


def _solver(gram: np.ndarray, ridge: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    from scipy.linalg import cho_factor, cho_solve

    scale = np.mean(np.diag(gram))
    factor = cho_factor(gram + np.diag(ridge + 1e-13 * scale), lower=True)
    return lambda b: cho_solve(factor, b)


def _sharpen(t: np.ndarray, y: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Gauss-Newton on all lines' frequencies together, amplitudes projected out."""
    limit = 0.3 / (t[-1] - t[0])
    start = lines
    for _ in range(3):
        basis = waves(t, lines)
        c = np.linalg.lstsq(basis, y, rcond=None)[0]
        e = y - basis @ c
        m = len(lines)
        arm = 2.0 * np.pi * t[:, None]
        jac = []
        for d in range(y.shape[1]):
            jac.append(arm * (-basis[:, m + 1 :] * c[1 : m + 1, d] + basis[:, 1 : m + 1] * c[m + 1 :, d]))
        q, _ = np.linalg.qr(basis)
        j = np.concatenate([x - q @ (q.T @ x) for x in jac])
        move = np.linalg.lstsq(j, e.T.ravel(), rcond=1e-8)[0]
        lines = np.clip(lines + np.clip(move, -limit, limit), start - limit, start + limit)
    return lines
