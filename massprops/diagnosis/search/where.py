"""Where the disagreement is: by sensor, interval, feature, image region and direction on the body."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from massprops.geometry.vectors import unit
from massprops.model.linearise import Residuals
from massprops.model.measurements import Measurements
from massprops.model.problem import Problem

INTERVALS = 12
CELLS = 4
WORST = 12
FEWEST = 8
"""Values below which a place says nothing."""
LARGEST = 36.0
"""Squares beyond this (6 sigma) count no more: one wrong track is not a place."""


def worst_places(problem: Problem, m: Measurements, r: Residuals, points: np.ndarray) -> list[dict[str, Any]]:
    """The places whose residuals are too large or lean to one side, worst first.

    Each entry holds `channel`, `interval_s`, `features`, `z` (how far beyond chance, in sigmas), `size` (rms over the
    noise), `bias` (mean over the noise), and `region` (image columns and rows [px]) or `direction` (body axes) where
    that is what the place is.
    """
    edges = np.linspace(0, float(problem.times[-1]), INTERVALS + 1)
    out = [*_of_tracks(problem, m, r, points, edges), *_of_series(problem.times, m, r, edges)]
    return sorted((p for p in out if p is not None), key=lambda e: -e["z"])[:WORST]


def _place(
    channel: str, values: np.ndarray, interval: Iterable[float], features: list[int], **more: Any
) -> dict[str, Any] | None:
    """An entry of `worst_places`; None of too few values."""
    n = values.size
    if n < FEWEST:
        return None
    squares = np.minimum(values.reshape(-1) ** 2, LARGEST)
    size = (squares.sum() - n) / np.sqrt(2.0 * n)
    bias = float(np.clip(values, -6, 6).mean())
    return {
        "channel": channel,
        "interval_s": [float(t) for t in interval],
        "features": features,
        "z": float(max(size, abs(bias * np.sqrt(n)))),
        "size": float(np.sqrt(squares.mean())),
        "bias": bias,
        **more,
    }


def _of_tracks(
    problem: Problem, m: Measurements, r: Residuals, points: np.ndarray, edges: np.ndarray
) -> Iterator[dict[str, Any] | None]:
    """By interval and component, by part of the image, by feature, and by side of the body."""
    if not len(m.uv):
        return
    whole = (edges[0], edges[-1])
    which = np.clip(np.searchsorted(edges, problem.times[m.seen.epoch], side="right") - 1, 0, INTERVALS - 1)
    for c in np.unique(m.seen.camera):
        of_camera = m.seen.camera == c
        for axis, letter in enumerate("uv"):
            for k in range(INTERVALS):
                yield _place(f"cam{c} {letter}", r.tracks[of_camera & (which == k), axis], edges[k : k + 2], [])
        low, high = np.percentile(m.uv[of_camera], [0, 100], axis=0)
        side = (high - low) / CELLS
        cell = np.clip(((m.uv - low) / np.maximum(high - low, 1e-9) * CELLS).astype(int), 0, CELLS - 1)
        for i in range(CELLS):
            for j in range(CELLS):
                here = of_camera & (cell[:, 0] == i) & (cell[:, 1] == j)
                region = [*(low + [i, j] * side), *(low + [i + 1, j + 1] * side)]
                yield _place(f"cam{c}", r.tracks[here], whole, [], region=[float(v) for v in region])
    for j in np.unique(m.seen.feature):
        yield _place("tracks", r.tracks[m.seen.feature == j], whole, [int(problem.features[j])])
    away = unit(points)
    for axis, letter in enumerate("xyz"):
        for sign in (1, -1):
            beyond = sign * away[m.seen.feature, axis] > 0.7
            yield _place("tracks", r.tracks[beyond], whole, [], direction=f"{'+' if sign > 0 else '-'}{letter}")


def _of_series(times: np.ndarray, m: Measurements, r: Residuals, edges: np.ndarray) -> Iterator[dict[str, Any] | None]:
    """By interval, of what is not tracks."""
    for channel, values, at in (
        ("range", r.range, m.range_at),
        ("rate", r.rates, m.rate_at),
        ("attitude", r.attitude, m.attitude_at),
    ):
        for k in range(INTERVALS):
            within = (times[at] >= edges[k]) & (times[at] <= edges[k + 1])
            yield _place(channel, values[within], edges[k : k + 2], [])
