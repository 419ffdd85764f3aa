"""Box plots as inline SVG: the box from the 25th to the 75th percentile, whiskers to the 5th and 95th."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from massprops.report.html import round_marks
from massprops.report.svg import Axes, box, dot, drawing, legend, line, words

SIZE, MARGIN = (640, 240), (68, 12, 10, 20)
MOST_DOTS = 60


def box_plot(named: list[tuple[str, np.ndarray]], title: str) -> str:
    """One box per series of (n,) numbers.

    The axis is logarithmic when all numbers are positive and reach over more than a factor of 30. Numbers outside the
    whiskers are dots, of many the outermost.
    """
    named = [(name, np.sort(np.asarray(values, float))) for name, values in named if len(values)]
    if not named:
        return ""
    every = np.concatenate([values for _, values in named])
    log = bool(every.min() > 0 and every.max() > 30 * every.min())

    def scaled(values: np.ndarray | float) -> np.ndarray:
        return np.log10(values) if log else np.asarray(values)

    low, high = float(scaled(every).min()), float(scaled(every).max())
    pad = 0.05 * (high - low) or 0.5 * abs(high) or 0.5
    axes = Axes((0.0, len(named)), (low - pad, high + pad), SIZE, MARGIN)
    step = (SIZE[0] - MARGIN[0] - MARGIN[1]) / len(named)
    names_below = len(named) <= 8 and all(len(name) * 7 < step for name, _ in named)
    parts = [axes.rows(_ticks(*axes.y, log), lambda tick: _shown(10.0**tick if log else tick))]
    for k, (name, values) in enumerate(named):
        x = float(axes.right(k + 0.5))
        parts.append(_box(x, min(26.0, 0.3 * step), values, lambda v: axes.down(scaled(v)), k))
        parts.append(words(x, SIZE[1] - 5, name if names_below else str(k + 1)))
    listed = [] if names_below else [(f"{k + 1}: {name}", f"s{k % 6}") for k, (name, _) in enumerate(named)]
    return drawing(parts, SIZE, f"box plot of {title}", "plot") + legend(listed)


def _box(x: float, half: float, values: np.ndarray, py: Callable[[float], Any], k: int) -> str:
    p5, p25, p50, p75, p95 = (float(py(v)) for v in np.percentile(values, (5, 25, 50, 75, 95)))
    style = f'class="s{k % 6}" fill="none" stroke-width="1.4"'
    lines = [
        box(x - half, p75, 2 * half, max(p25 - p75, 0.8), style),
        line(x - half, p50, x + half, p50, style),
    ]
    for inner, outer in ((p25, p5), (p75, p95)):
        lines += [line(x, inner, x, outer, style), line(x - half / 2, outer, x + half / 2, outer, style)]
    bounds = np.percentile(values, (5, 95))
    below, above = values[values < bounds[0]], values[values > bounds[1]]
    for value in (*below[: MOST_DOTS // 2], *above[::-1][: MOST_DOTS // 2]):
        lines.append(dot(x, float(py(value)), 1.8, style))
    return "".join(lines)


def _shown(tick: float) -> str:
    """A round number in few letters, for the narrow room left of an axis."""
    return f"{tick:.3g}".replace("-", "−")


def _ticks(low: float, high: float, log: bool) -> list[float]:
    """Round numbers between two; of a logarithmic axis their logarithms."""
    if not log:
        return round_marks(low, high)
    whole = np.arange(np.ceil(low), np.floor(high) + 1)
    if len(whole) >= 2:
        return [float(t) for t in whole[:: max(1, len(whole) // 6)]]
    return [float(np.log10(t)) for t in round_marks(10.0**low, 10.0**high) if t > 0]
