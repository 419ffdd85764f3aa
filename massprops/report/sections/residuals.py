"""How well the images fit: residuals image by image, over the sensor, and which images see the same points."""

from __future__ import annotations

import numpy as np

from massprops.report.data import RunData
from massprops.report.html import data_uri, number, swatch
from massprops.report.plot import plot
from massprops.report.svg import dot, drawing, line, pane

TITLE, ORDER = "Images and calibration", 4.5
CELLS = (12, 9)
LEAST = 5
"""Observations in a cell of the sensor, or of an image, from which a mean is told."""


def render(data: RunData) -> str:
    """Residual of each image, mean residual over the sensor, points in common; nothing without observations."""
    points = data.points
    if points is None or data.views is None or not len(points.obs_uv):
        return ""
    from massprops.sfm.points import residuals

    residuals_px = residuals(data.views, points)
    if residuals_px.shape != points.obs_uv.shape:
        return ""
    return (
        f'<div class="two"><div><h3>Residual of each image</h3>{_by_image(residuals_px, points.obs_view, len(data.views))}'
        f"<h3>Points in common</h3>{_overlap(data)}</div>"
        f"<div><h3>Mean residual over the sensor</h3>{_over_sensor(data, residuals_px)}</div></div>"
    )


def _by_image(left: np.ndarray, view: np.ndarray, count: int) -> str:
    seen = np.bincount(view, minlength=count)
    rms = np.sqrt(np.bincount(view, np.sum(left**2, axis=1), count) / np.maximum(seen, 1))
    rms = np.where(seen >= LEAST, rms, np.nan)
    if not np.isfinite(rms).any():
        return ""
    worst = int(np.nanargmax(rms))
    drawn = plot([("", np.arange(1, count + 1), rms)], "image", "rms [px]", 560, 220)
    return (
        drawn
        + f'<p class="soft">Distance between where a point is seen and where the model puts it. The worst is image {worst + 1}, '
        f"{number(float(rms[worst]), 2)} px; the median is {number(float(np.nanmedian(rms)), 2)} px, with "
        f"{int(np.median(seen))} points per image.</p>"
    )


def _over_sensor(data: RunData, left: np.ndarray) -> str:
    """Arrows of the mean residual of each cell: what a wrong lens model leaves."""
    points, views = data.points, data.views
    width, height = views.size[points.obs_view, 0], views.size[points.obs_view, 1]
    column = np.clip((points.obs_uv[:, 0] / width * CELLS[0]).astype(int), 0, CELLS[0] - 1)
    row = np.clip((points.obs_uv[:, 1] / height * CELLS[1]).astype(int), 0, CELLS[1] - 1)
    cell = row * CELLS[0] + column
    total = CELLS[0] * CELLS[1]
    seen = np.bincount(cell, minlength=total)
    mean = np.stack([np.bincount(cell, left[:, k], total) for k in (0, 1)], axis=1) / np.maximum(seen, 1)[:, None]
    good = seen >= LEAST
    if not good.any():
        return ""
    longest = float(np.linalg.norm(mean[good], axis=1).max()) or 1.0
    w, h = 480, round(480 * float(views.size[0, 1]) / float(views.size[0, 0]))
    parts = [pane(0, 0, w, h, 4)]
    for k in np.flatnonzero(good):
        x, y = (k % CELLS[0] + 0.5) * w / CELLS[0], (k // CELLS[0] + 0.5) * h / CELLS[1]
        dx, dy = mean[k] / longest * 0.8 * w / CELLS[0]
        parts += [line(x, y, x + dx, y + dy, 'class="arrow"'), dot(x, y, 1.8, 'class="foot"')]
    return drawing(parts, (w, h), "mean residual over the sensor", rim=(2, 2)) + (
        f'<p class="soft">The longest arrow is {number(longest, 2)} px. If neighbouring arrows turn or point '
        "outward together, the lens model is wrong. Arrows without order are noise.</p>"
    )


def _overlap(data: RunData) -> str:
    """A picture of how many points two images share."""
    from scipy.sparse import csr_matrix

    points, n = data.points, len(data.views)
    ones = np.ones(len(points.obs_view), np.float32)
    seen = csr_matrix((ones, (points.obs_view, points.obs_point)), shape=(n, int(points.obs_point.max()) + 1))
    shared = (seen @ seen.T).toarray()
    np.fill_diagonal(shared, 0)
    most = float(shared.max()) or 1.0
    share = np.sqrt(shared / most)[..., None]
    low, high = np.array([236, 240, 243.0]), np.array([20, 104, 140.0])
    rgb = np.where(shared[..., None] > 0, (1 - share) * (low - 40) + share * high, low)
    step = max(1, 360 // n)
    image = np.kron(rgb[:, :, ::-1], np.ones((step, step, 1))).astype(np.uint8)
    alone = int((shared.max(axis=1) < LEAST).sum())
    keys = swatch("#ecf0f3", "none") + swatch("#14688c", f"{int(most)} points")
    return (
        f'<img class="matrix" alt="points that two images have in common" src="{data_uri(image, "png")}">'
        f'<p class="soft keys">{keys}</p><p class="soft">Image by image, first to last, to the right and down. '
        f"{alone} of {n} images share fewer than {LEAST} points with any other.</p>"
    )
