"""How large residuals are against their noise, and whether they are white."""

from __future__ import annotations

import numpy as np

from massprops.model.linearise import Residuals
from massprops.model.measurements import Measurements

TRIMMED = 0.02
"""Share of the largest residuals that never counts: wrong tracks."""
WHITE = 4.0
"""Score of the correlation between neighbours beyond which residuals have structure."""


def _parts(r: Residuals) -> list[tuple[np.ndarray, int]]:
    return [
        (np.sum(part.reshape(len(part), -1) ** 2, axis=1), dimension)
        for part, dimension in ((r.tracks, 2), (r.range, 1), (r.rates, 3), (r.attitude, 3))
        if len(part)
    ]


def trimmed(squares: np.ndarray, dimension: int) -> float:
    """Mean of squares (n,) of vectors per scalar without the largest, corrected so that normal noise gives 1."""
    from scipy.special import chdtr, gammaincinv  # scipy.stats takes a second to load

    if len(squares) < 20:
        return float(np.mean(squares)) / dimension if len(squares) else 0.0
    keep = int(np.ceil((1 - TRIMMED) * len(squares)))
    part = np.sort(squares)[:keep]
    edge = 2 * gammaincinv(dimension / 2, 1 - TRIMMED)
    expected = dimension * chdtr(dimension + 2, edge) / (1 - TRIMMED)
    return float(part.mean() / expected)


def mean_square(r: Residuals) -> float:
    """Over all channels, per scalar, in units of the stated noise: 1 at the noise floor."""
    total = scalars = 0.0
    for squares, dimension in _parts(r):
        count = len(squares) * dimension
        total += trimmed(squares, dimension) * count
        scalars += count
    return total / scalars if scalars else float("nan")


def count(r: Residuals) -> int:
    """Scalars."""
    return sum(len(squares) * dimension for squares, dimension in _parts(r))


def whiteness(r: Residuals, m: Measurements, rate_memory: int = 1) -> float:
    """Score of the correlation between neighbouring residuals of the same sensor: standard normal for white noise.

    Tracks are compared along time within a camera and feature. Residuals are taken relative to their own size, so a
    wrongly stated noise does not count as structure.
    """
    products, scale = 0.0, 0.0
    order = np.lexsort((m.seen.epoch, m.seen.feature, m.seen.camera))
    series = []
    if len(order) > 1:
        who = m.seen.camera[order] * (1 + int(m.seen.feature.max(initial=0))) + m.seen.feature[order]
        together = (who[1:] == who[:-1]) & (np.diff(m.seen.epoch[order]) <= 3)
        series.append((r.tracks[order], together, 1))
    for values, at in ((r.range[:, None], m.range_at), (r.rates, m.rate_at), (r.attitude, m.attitude_at)):
        if len(values) > 1:
            gap = np.diff(at)
            series.append((values, gap <= 3 * np.median(gap), rate_memory if values is r.rates else 1))
    for values, together, lag in series:
        if lag > 1:
            if len(values) <= 2 * lag:
                continue
            values, together = values[::lag], np.ones(len(values[::lag]) - 1, bool)
        size = max(float(np.median(np.abs(values))) / 0.6745, 1e-12)
        x = np.clip(values / size, -4, 4)
        # each pair used once: neighbours that share a residual are not independent of each other
        pair_products = (x[1:] * x[:-1])[together]
        products += float(pair_products.sum())
        scale += float((pair_products**2).sum())
    return products / np.sqrt(scale) if scale else 0.0
