"""The noise of tracks that state none, from the tracks: white noise looks the same in differences of every order."""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.model.problem import Problem, no_sigma_px
from massprops.sequence.data import Sequence

ORDERS = range(2, 9)
ALIKE = 0.1
"""Relative difference between two orders at which motion no longer counts in them."""
FEWEST = 100


def with_track_noise(sequence: Sequence, problem: Problem) -> Problem:
    """The problem with the noise of those cameras estimated that state none, and its warnings put right."""
    sigma, warnings = problem.sigma_px.copy(), list(problem.warnings)
    for k in (k for k in sorted(sequence.cameras) if no_sigma_px(k) in warnings):
        place = min(k, len(sigma) - 1)
        noise_px = track_noise(problem.uv[:, place])
        if noise_px is None:
            continue
        sigma[place] = noise_px
        warnings = [w for w in warnings if w != no_sigma_px(k)]
        warnings.append(f"cam{k} states no sigma_px: {noise_px:.3g} px is estimated from the tracks")
    return replace(problem, sigma_px=sigma, warnings=tuple(warnings))


def track_noise(uv: np.ndarray) -> float | None:
    """1-sigma [px] of white noise in tracks (n, m, 2), NaN where there is none; None where motion hides it."""
    sizes = []
    for order in ORDERS:
        d = np.diff(uv, order, axis=0) / np.sqrt(comb(2 * order, order))
        d = d[np.isfinite(d)]
        if len(d) < FEWEST:
            break
        sizes.append(mad_sigma(d))
    for this, following in zip(sizes[:-1], sizes[1:], strict=True):
        if this > 0 and abs(following - this) < ALIKE * this:
            return following
    return None
