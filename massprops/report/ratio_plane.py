"""The plane of k1 and k2: mesh (or truth) and estimators as points with their 90 % ellipses, as inline SVG."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.report.curves import OWN, method_style
from massprops.report.html import round_marks, text
from massprops.report.svg import Axes, clipped, dot, drawing, legend, pane, polygon

NINETY = 2.1460
"""Radius of the 90 % ellipse of two normal variables, sqrt(-2 ln 0.1)."""
REACH = 3.0
"""Methods farther off than so many times the reach of what is drawn thick are named instead of drawn."""
SIZE, MARGIN = (480, 360), (62, 10, 10, 40)


@dataclass(frozen=True)
class Mark:
    """name: of one method, or of several that say the same; k (2,); outline (n, 2) of the ellipse, or (0, 2)."""

    name: str
    k: np.ndarray
    outline: np.ndarray
    style: str


def ratio_plane(own: dict[str, Any], estimators: list[dict[str, Any]], reference: str = "") -> str:
    """The plane, or nothing where nobody gives ratios.

    Args:
        own: `k1`, `k2` and what else `crosscheck.json` says of the mesh, or the truth (`name`); {} for none.
        estimators: as in `crosscheck.json`.
        reference: the estimator that counts most, drawn thick as `own` is.
    """
    # one that did not converge would shrink all the others
    sound = [e for e in estimators if e.get("converged") is not False]
    marks = _marks(own, sound)
    if not marks:
        return ""
    core = [m for m in marks if m.style == OWN or reference in m.name.split(", ")]
    if not any(len(m.outline) for m in core):
        core = marks
    low, high = _bounds(core)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-4)
    near = [m for m in marks if (np.abs(m.k - middle) <= REACH * half).all()]
    low, high = _bounds([*core, *(_within(m, middle, REACH * half) for m in near)])
    pad = 0.08 * np.maximum(high - low, 1e-4)
    (x0, y0), (x1, y1) = low - pad, high + pad
    axes = Axes((x0, x1), (y0, y1), SIZE, MARGIN)
    drawn = [_drawn(m, axes, thick=m in core) for m in near]
    far = [m.name for m in marks if m not in near]
    note = "Ellipses contain 90 % of the probability. Methods that did not converge are left out." + (
        f" Outside the chart: {text(', '.join(far))}." if far else ""
    )
    left, right, top, bottom = MARGIN
    inside = (left, top, SIZE[0] - left - right, SIZE[1] - top - bottom)
    parts = (
        pane(*inside),
        axes.columns(round_marks(x0, x1), lines=True),
        axes.rows(round_marks(y0, y1)),
        axes.titles("k1", "k2"),
        clipped(drawn[::-1], *inside),
    )
    return (
        drawing(parts, SIZE, "k1 and k2 of every method")
        + legend((m.name, m.style) for m in near)
        + f'<p class="soft">{note}</p>'
    )


def _marks(own: dict[str, Any], estimators: list[dict[str, Any]]) -> list[Mark]:
    marks: list[Mark] = []
    for entry in (own, *estimators):
        name = str(entry.get("name") or "mesh")
        k = np.array([_finite(entry.get("k1")), _finite(entry.get("k2"))])
        if not np.isfinite(k).all():
            continue
        same = [i for i, m in enumerate(marks) if m.style != OWN and np.abs(m.k - k).max() < 1e-7]
        if same:
            old = marks[same[0]]
            marks[same[0]] = Mark(f"{old.name}, {name}", old.k, old.outline, old.style)
            continue
        style = OWN if entry is own else method_style(name)
        marks.append(Mark(name, k, _outline(entry, k), style))
    return marks


def _outline(entry: dict[str, Any], k: np.ndarray) -> np.ndarray:
    sigma = np.array([_finite(entry.get("sigma_k1")), _finite(entry.get("sigma_k2"))])
    if not np.isfinite(sigma).all():
        return np.zeros((0, 2))
    whole = entry.get("k_covariance")
    covariance = np.diag(sigma**2) if whole is None else np.array(whole, float).reshape(2, 2)
    values, vectors = np.linalg.eigh(covariance)
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    return k + NINETY * circle * np.sqrt(np.maximum(values, 0.0)) @ vectors.T


def _finite(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else np.nan


def _within(one: Mark, middle: np.ndarray, reach: np.ndarray) -> Mark:
    """The mark, without its ellipse where that goes beyond the reach (2,) about the middle (2,)."""
    whole = (np.abs(one.outline - middle) <= reach).all()
    return one if whole else Mark(one.name, one.k, one.k[None], one.style)


def _bounds(marks: list[Mark]) -> tuple[np.ndarray, np.ndarray]:
    points = np.vstack([np.vstack([m.k[None], m.outline]) for m in marks])
    return points.min(0), points.max(0)


def _drawn(one: Mark, axes: Axes, thick: bool) -> str:
    points = axes.points(one.outline[:, 0], one.outline[:, 1])
    kind = f"{one.style}{' thick' if thick else ''}"
    ring = polygon(points, f'class="ring {kind}"') if points else ""
    return ring + dot(
        float(axes.right(one.k[0])), float(axes.down(one.k[1])), 4 if thick else 2.5, f'class="dot {kind}"'
    )
