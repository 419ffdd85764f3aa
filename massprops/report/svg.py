"""Inline SVG: a drawing and what it is made of, a pair of axes with grid, numbers and titles, a legend. Lengths in pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from massprops.report.html import mark, text

GRID = 'class="grid"'


def drawing(
    parts: Iterable[str], size: tuple[float, float], label: str, kind: str = "", rim: tuple[int, int] = (0, 0)
) -> str:
    """The parts as a picture of a width and height, with a rim about it; label: what it shows, for those who listen."""
    (w, h), (x, y) = size, rim
    style = f'class="{kind}" ' if kind else ""
    box = f"{-x} {-y} {w + 2 * x:.0f} {h + 2 * y:.0f}"
    return f'<svg {style}viewBox="{box}" role="img" aria-label="{text(label)}">{"".join(parts)}</svg>'


def line(x0: float, y0: float, x1: float, y1: float, style: str) -> str:
    """style: attributes, as `class="grid"`."""
    return f'<line {style} x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"/>'


def dot(x: float, y: float, radius: float, style: str, title: str = "") -> str:
    """style: attributes; title: said where the mouse rests on it."""
    inner = f"><title>{text(title)}</title></circle>" if title else "/>"
    return f'<circle {style} cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"{inner}'


def dots(points: np.ndarray, radius: float, style: str) -> str:
    """Dots at points (n, 2) as one element, which a browser lays out far faster than one for each; style: attributes."""
    places = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in points)
    return f'<path {style} stroke="currentColor" stroke-width="{2 * radius:.1f}" stroke-linecap="round" d="{places}"/>'


def words(x: float, y: float, content: str, anchor: str = "middle", style: str = "") -> str:
    """Text whose `anchor` (start, middle, end) lies at x, y; style: attributes."""
    return f'<text {style} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text(content)}</text>'


def box(x: float, y: float, width: float, height: float, style: str, round_by: float = 0.0) -> str:
    """A rectangle from its upper left corner; style: attributes; round_by: radius of its corners."""
    rounded = f' rx="{round_by:g}"' if round_by else ""
    return f'<rect {style} x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"{rounded}/>'


def pane(x: float, y: float, width: float, height: float, round_by: float = 0.0) -> str:
    """The ground that something is drawn on."""
    return box(x, y, width, height, 'class="pane"', round_by)


def curve(points: np.ndarray, style: str) -> str:
    """A line through points (n, 2); style: attributes."""
    return polyline(" ".join(f"{a:.1f},{b:.1f}" for a, b in points), style)


def polyline(points: str, style: str) -> str:
    """A line through points as of `Axes.points`; style: attributes."""
    return f'<polyline {style} points="{points}"/>'


def polygon(points: str, style: str) -> str:
    """An area within points as of `Axes.points`; style: attributes."""
    return f'<polygon {style} points="{points}"/>'


def clipped(parts: Iterable[str], x: float, y: float, width: float, height: float) -> str:
    """What of the parts lies within a rectangle; one such on a page."""
    return (
        f'<clipPath id="plane">{box(x, y, width, height, "")}</clipPath><g clip-path="url(#plane)">{"".join(parts)}</g>'
    )


def picture(address: str, width: float, height: float) -> str:
    """An image at a data address."""
    return f'<image width="{width:g}" height="{height:g}" href="{address}"/>'


def legend(named: Iterable[tuple[str, str]]) -> str:
    """Names with their classes of `style.css`; nothing without names."""
    keys = "".join(f'<span class="key {style}">{text(name)}</span>' for name, style in named)
    return f'<div class="legend">{keys}</div>' if keys else ""


@dataclass(frozen=True)
class Axes:
    """A drawing with a linear scale along each side.

    Attributes:
        x, y: least and greatest number to the right and up.
        size: width and height [px].
        margin: left, right, top and bottom of what is drawn [px].
    """

    x: tuple[float, float]
    y: tuple[float, float]
    size: tuple[int, int]
    margin: tuple[int, int, int, int]

    def right(self, value: np.ndarray | float) -> np.ndarray:
        """Pixels from the left edge."""
        left, right, _, _ = self.margin
        low, high = self.x
        return left + (np.asarray(value, float) - low) / (high - low) * (self.size[0] - left - right)

    def down(self, value: np.ndarray | float) -> np.ndarray:
        """Pixels from the top edge."""
        _, _, top, bottom = self.margin
        low, high = self.y
        return top + (high - np.asarray(value, float)) / (high - low) * (self.size[1] - top - bottom)

    def points(self, x: np.ndarray, y: np.ndarray) -> str:
        """The `points` of a line or polygon."""
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(self.right(x), self.down(y), strict=True))

    def rows(self, ticks: Iterable[float], label: Callable[[float], str] = mark) -> str:
        """A line across at each tick of y, with its number on the left."""
        left, right, _, _ = self.margin
        at = [(tick, float(self.down(tick))) for tick in ticks]
        return "".join(
            line(left, y, self.size[0] - right, y, GRID) + words(left - 6, y + 4, label(tick), "end") for tick, y in at
        )

    def columns(self, ticks: Iterable[float], lines: bool = False) -> str:
        """The number of each tick of x below, with a line up where asked for."""
        _, _, top, bottom = self.margin
        low = self.size[1] - bottom
        parts = []
        for tick in ticks:
            x = float(self.right(tick))
            if lines:
                parts.append(line(x, top, x, low, GRID))
            parts.append(words(x, low + 16, mark(tick)))
        return "".join(parts)

    def titles(self, x: str, y: str) -> str:
        """What is drawn to the right, where that needs a title, and up."""
        width, height = self.size
        below = words((self.margin[0] + width) / 2, height - 4, x)
        beside = f'<text transform="translate(14 {height / 2:.0f}) rotate(-90)" text-anchor="middle">{text(y)}</text>'
        return (below if x else "") + beside
