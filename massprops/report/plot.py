"""A line plot as inline SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from massprops.report.curves import COLOURS
from massprops.report.html import mark, round_marks
from massprops.report.svg import Axes, drawing, legend, polygon, polyline


def _pieces(y: np.ndarray) -> list[np.ndarray]:
    """Indices of each unbroken run of finite numbers; of a lone one twice, so that it is seen as a dot."""
    good = np.flatnonzero(np.isfinite(y))
    runs = np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)
    return [np.repeat(run, 2) if len(run) == 1 else run for run in runs if len(run)]


def plot(
    series: Sequence[tuple[str, np.ndarray, np.ndarray]],
    x_label: str,
    y_label: str,
    width: int = 640,
    height: int = 240,
    bands: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]] = (),
    styles: Sequence[str] = (),
) -> str:
    """Series of (name, x, y) as lines, bands of (x, low, high) as areas behind them; nothing without finite numbers.

    A line ends where a number is missing and begins again after it. styles: classes of each line in `style.css`; a colour
    by its place without.
    """
    return _drawn(series, (x_label, y_label), (width, height), bands, styles)


DECADE = (1, 2, 5)
MOST_MARKS = 7
"""Numbers beside a logarithmic scale, above which only powers of ten are written."""


def log_plot(
    series: Sequence[tuple[str, np.ndarray, np.ndarray]], x_label: str, y_label: str, styles: Sequence[str] = ()
) -> str:
    """As `plot`, with a logarithmic scale upwards: numbers that are not above 0 are missing."""
    scaled = []
    for name, x, y in series:
        values = np.asarray(y, float)
        above = np.where(values > 0.0, values, np.nan)
        scaled.append((name, x, np.log10(above)))
    return _drawn(scaled, (x_label, y_label), (640, 240), (), styles, _log_rows)


def _linear_rows(axes: Axes) -> str:
    return axes.rows(round_marks(*axes.y))


def _log_rows(axes: Axes) -> str:
    """Lines at 1, 2 and 5 of each power of ten, or at powers of ten alone."""
    low, high = (int(np.floor(v)) for v in axes.y)
    powers = range(low, high + 1)
    marks = [d * 10.0**k for k in powers for d in DECADE if axes.y[0] <= np.log10(d) + k <= axes.y[1]]
    if len(marks) > MOST_MARKS:
        whole = [k for k in powers if axes.y[0] <= k <= axes.y[1]]
        marks = [10.0**k for k in whole[:: 1 + (len(whole) - 1) // MOST_MARKS]]
    return axes.rows([float(np.log10(m)) for m in marks], lambda v: mark(float(f"{10.0**v:.6g}")))


def _drawn(
    series: Sequence[tuple[str, np.ndarray, np.ndarray]],
    labels: tuple[str, str],
    size: tuple[int, int],
    bands: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    styles: Sequence[str],
    rows: Callable[[Axes], str] = _linear_rows,
) -> str:
    """See `plot`; labels: of x and y; rows: draws the scale upwards."""
    styles = styles or [f"s{k % COLOURS}" for k in range(len(series))]
    xs = np.concatenate([np.asarray(s[1], float) for s in series]) if series else np.zeros(1)
    values = [np.asarray(s[2], float) for s in series] + [np.asarray(v, float) for b in bands for v in b[1:]]
    ys = np.concatenate(values) if values else np.zeros(1)
    ys = ys[np.isfinite(ys)]
    if len(ys) == 0 or len(xs) == 0:
        return ""
    x0, x1 = float(xs.min()), float(xs.max())
    y0, y1 = float(ys.min()), float(ys.max())
    x1, pad = (x1 if x1 > x0 else x0 + 1), 0.05 * (y1 - y0) or 0.5 * abs(y0) or 0.5
    axes = Axes((x0, x1), (y0 - pad, y1 + pad), size, (80, 12, 10, 34))
    parts = [rows(axes), axes.columns(round_marks(*axes.x))]
    for x, low, high in bands:
        low, high = (np.clip(np.asarray(v, float), *axes.y) for v in (low, high))
        area = f"{axes.points(x, high)} {axes.points(x[::-1], low[::-1])}"
        parts.append(polygon(area, 'class="band"'))
    for (_name, x, y), style in zip(series, styles, strict=True):
        for piece in _pieces(np.asarray(y, float)):
            points = axes.points(np.asarray(x)[piece], np.asarray(y)[piece])
            parts.append(polyline(points, f'class="{style}"'))
    parts.append(axes.titles(*labels))
    named = [(name, style) for (name, _, _), style in zip(series, styles, strict=True) if name]
    return drawing(parts, size, f"{labels[1]} over {labels[0]}", "plot") + legend(named)
