"""A pair of axes as inline SVG: where numbers lie on a drawing, its grid, its numbers and its titles."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from massprops.report.html import mark, text


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
        pixel: np.ndarray = left + (np.asarray(value, float) - low) / (high - low) * (self.size[0] - left - right)
        return pixel

    def down(self, value: np.ndarray | float) -> np.ndarray:
        """Pixels from the top edge."""
        _, _, top, bottom = self.margin
        low, high = self.y
        pixel: np.ndarray = top + (high - np.asarray(value, float)) / (high - low) * (self.size[1] - top - bottom)
        return pixel

    def points(self, x: np.ndarray, y: np.ndarray) -> str:
        """The `points` of a line or polygon."""
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(self.right(x), self.down(y), strict=True))

    def rows(self, ticks: Iterable[float], label: Callable[[float], str] = mark) -> str:
        """A line across at each tick of y, with its number on the left."""
        left, right, _, _ = self.margin
        at = [(tick, float(self.down(tick))) for tick in ticks]
        return "".join(
            f'<line class="grid" x1="{left}" x2="{self.size[0] - right}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{label(tick)}</text>'
            for tick, y in at
        )

    def columns(self, ticks: Iterable[float], lines: bool = False) -> str:
        """The number of each tick of x below, with a line up where asked for."""
        _, _, top, bottom = self.margin
        low = self.size[1] - bottom
        parts = []
        for tick in ticks:
            x = float(self.right(tick))
            if lines:
                parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{low}"/>')
            parts.append(f'<text x="{x:.1f}" y="{low + 16}" text-anchor="middle">{mark(tick)}</text>')
        return "".join(parts)

    def titles(self, x: str, y: str) -> str:
        """What is drawn to the right, where that needs a title, and up."""
        width, height = self.size
        below = f'<text x="{(self.margin[0] + width) / 2:.0f}" y="{height - 4}" text-anchor="middle">{text(x)}</text>'
        beside = f'<text transform="translate(14 {height / 2:.0f}) rotate(-90)" text-anchor="middle">{text(y)}</text>'
        return (below if x else "") + beside
