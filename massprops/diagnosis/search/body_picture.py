"""Where on the body: feature points in body axes, coloured by the size of their residuals, before and after."""

from __future__ import annotations

import numpy as np

from massprops.model.linearise import Residuals
from massprops.model.measurements import Measurements
from massprops.report.html import number
from massprops.report.svg import GRID, dot, drawing, line, words

SIDE = 190.0
VIEWS = ((0, 1), (1, 2), (2, 0))
"""Axes to the right and up of each view."""
LARGEST = 36.0
"""Squares beyond this (6 sigma) count no more: one wrong track is not a place."""
COLOURS = ((39, 174, 96), (241, 196, 15), (192, 57, 43))
FEWEST = 8
MOST_SURFACE = 1500


def feature_residuals(m: Measurements, r: Residuals, count: int) -> tuple[np.ndarray, np.ndarray]:
    """rms over the noise and z (how far beyond chance, in sigmas) of each feature (count,); NaN where hardly seen."""
    squares = np.minimum(r.tracks**2, LARGEST)
    total = np.bincount(m.seen.feature, squares.sum(axis=1), minlength=count)
    n = 2.0 * np.bincount(m.seen.feature, minlength=count)
    with np.errstate(invalid="ignore", divide="ignore"):
        rms, z = np.sqrt(total / n), (total - n) / np.sqrt(2.0 * n)
    return np.where(n >= FEWEST, rms, np.nan), np.where(n >= FEWEST, z, np.nan)


def body_picture(
    points: np.ndarray,
    numbers: np.ndarray,
    m: Measurements,
    before: Residuals,
    after: Residuals,
    surface: np.ndarray | None = None,
) -> str:
    """Three views of the features in body axes as inline SVG, one row before and one after; empty without features.

    Args:
        points: (k, 3) features from the centre of mass, body axes [m]; numbers: (k,) how the sequence calls them.
        m: the measurements; before, after: their residuals.
        surface: (s, 3) points of the body's surface in the same axes, drawn behind.
    """
    if not len(m.uv):
        return ""
    rows = [(name, *feature_residuals(m, r, len(points))) for name, r in (("before", before), ("after", after))]
    shown = np.flatnonzero(np.isfinite(rows[0][1]))
    if not len(shown):
        return ""
    skin = np.zeros((0, 3)) if surface is None else surface[:: max(1, len(surface) // MOST_SURFACE)]
    reach = 1.1 * float(np.abs(np.concatenate([points[shown], skin])).max()) or 1.0
    worst = max(float(np.nanmax(rows[0][1][shown])), 1.5)
    width, height = SIDE * len(VIEWS), SIDE * len(rows)
    parts = []
    for row, (name, rms, z) in enumerate(rows):
        for column, (right, up) in enumerate(VIEWS):
            x0, y0 = SIDE * (column + 0.5), SIDE * (row + 0.5)
            scale = 0.42 * SIDE / reach
            toward = 3 - right - up
            half, title = 0.46 * SIDE, f"{name}: {'xyz'[right]} right, {'xyz'[up]} up"
            parts += [line(x0 - half, y0, x0 + half, y0, GRID), line(x0, y0 - half, x0, y0 + half, GRID)]
            parts.append(words(x0 - half, y0 - 0.44 * SIDE, title, "start"))
            parts += [dot(x0 + scale * p[right], y0 - scale * p[up], 1, 'fill="#8885"') for p in skin]
            for k in sorted(shown, key=lambda k: points[k, toward]):
                near = 0.5 + 0.5 * points[k, toward] / reach
                label = f"feature {numbers[k]}: rms {number(rms[k], 3)} σ, z {number(z[k], 3)}"
                x, y, colour = x0 + scale * points[k, right], y0 - scale * points[k, up], colour_of(rms[k], worst)
                parts.append(dot(x, y, 4 + 3 * near, f'fill="{colour}"', label))
    return (
        f"<p>Features on the body, seen along its axes (larger is nearer). Green: at the noise. Red: {number(worst, 3)} "
        "times the noise.</p>"
        + drawing(parts, (width, height), "residuals on the body, three views, before and after", "plot")
    )


def colour_of(rms: float, worst: float) -> str:
    """Green at 1, over yellow, to red at `worst`, by the logarithm."""
    share = float(np.clip(np.log(max(rms, 1.0)) / np.log(worst), 0.0, 1.0)) * (len(COLOURS) - 1)
    k = min(int(share), len(COLOURS) - 2)
    mixed = [round(a + (share - k) * (b - a)) for a, b in zip(COLOURS[k], COLOURS[k + 1], strict=True)]
    return "#{:02x}{:02x}{:02x}".format(*mixed)
