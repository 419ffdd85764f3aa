"""Where the disagreement is: by sensor, interval, feature, image region and direction on the body."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.estimators.batch.linearise import Residuals
from massprops.estimators.batch.measurements import Measurements
from massprops.estimators.problem import Problem

INTERVALS = 12
CELLS = 4
WORST = 12
LARGEST = 36.0
"""Squares beyond this (6 sigma) count no more: one wrong track is not a place."""


def worst_places(problem: Problem, m: Measurements, r: Residuals, points: np.ndarray) -> list[dict[str, Any]]:
    """The places whose residuals are too large or lean to one side, worst first.

    Each entry holds `channel`, `interval_s`, `features`, `z` (how far beyond chance, in sigmas), `size` (rms over the
    noise), `bias` (mean over the noise), and `region` (image columns and rows [px]) or `direction` (body axes) where
    that is what the place is.
    """
    out: list[dict[str, Any]] = []
    times, span = problem.times, float(problem.times[-1])
    edges = np.linspace(0, span, INTERVALS + 1)
    whole = [0.0, span]

    def add(channel: str, values: np.ndarray, interval: list[float], features: list[int], **more: Any) -> None:
        n = values.size
        if n < 8:
            return
        squares = np.minimum(values.reshape(-1) ** 2, LARGEST)
        size = (squares.sum() - n) / np.sqrt(2.0 * n)
        lean = float(np.clip(values, -6, 6).mean()) * np.sqrt(n)
        out.append(
            {
                "channel": channel,
                "interval_s": interval,
                "features": features,
                "z": float(max(size, abs(lean))),
                "size": float(np.sqrt(squares.mean())),
                "bias": float(np.clip(values, -6, 6).mean()),
                **more,
            }
        )

    if len(m.uv):
        which = np.clip(np.searchsorted(edges, times[m.seen.epoch], side="right") - 1, 0, INTERVALS - 1)
        for c in np.unique(m.seen.camera):
            for axis, letter in enumerate("uv"):
                for k in range(INTERVALS):
                    own = (m.seen.camera == c) & (which == k)
                    add(f"cam{c} {letter}", r.tracks[own, axis], [float(edges[k]), float(edges[k + 1])], [])
            own = m.seen.camera == c
            low, high = np.percentile(m.uv[own], [0, 100], axis=0)
            cell = np.clip(((m.uv - low) / np.maximum(high - low, 1e-9) * CELLS).astype(int), 0, CELLS - 1)
            for i in range(CELLS):
                for j in range(CELLS):
                    here = own & (cell[:, 0] == i) & (cell[:, 1] == j)
                    side = (high - low) / CELLS
                    region = [*(low + [i, j] * side), *(low + [i + 1, j + 1] * side)]
                    add(f"cam{c}", r.tracks[here], whole, [], region=[float(v) for v in region])
        for j in np.unique(m.seen.feature):
            own = m.seen.feature == j
            add("tracks", r.tracks[own], whole, [int(problem.features[j])])
        away = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
        for axis, letter in enumerate("xyz"):
            for sign in (1, -1):
                own = sign * away[m.seen.feature, axis] > 0.7
                add("tracks", r.tracks[own], whole, [], direction=f"{'+' if sign > 0 else '-'}{letter}")
    for channel, values, at in (
        ("range", r.range, m.range_at),
        ("rate", r.rates, m.rate_at),
        ("attitude", r.attitude, m.attitude_at),
    ):
        for k in range(INTERVALS):
            own = (times[at] >= edges[k]) & (times[at] <= edges[k + 1])
            add(channel, values[own], [float(edges[k]), float(edges[k + 1])], [])
    out.sort(key=lambda e: -e["z"])
    return out[:WORST]
