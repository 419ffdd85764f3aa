"""Tells the two kinds of footage apart: a body that moves before a still camera, or a camera round a still object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

DARK = 40
"""Grey level below which a border counts as black sky."""


@dataclass(frozen=True)
class Scene:
    """motion: tumbling or static; background: black, still or moving; reason: one sentence; plain: no texture in it."""

    motion: str
    background: str
    reason: str
    plain: bool


def judge(frames: np.ndarray, ordered: bool) -> Scene:
    """The kind of footage, from what the border of the image does.

    Args:
        frames: (n, h, w) uint8, small grey frames spread over the footage.
        ordered: whether they follow each other in time (video) or are single photographs.
    """
    h, w = frames.shape[1:]
    band = max(2, round(0.06 * min(h, w)))
    border = np.zeros((h, w), bool)
    border[:band], border[-band:], border[:, :band], border[:, -band:] = True, True, True, True
    values = frames[:, border].astype(np.float32)
    middle = np.median(values, axis=0)
    change = np.median(np.abs(values - middle), axis=0)
    dark = float(np.mean(middle < DARK))
    if dark > 0.85 and np.percentile(middle, 75) < DARK / 2 + 5:
        return Scene("tumbling", "black", f"{100 * dark:.0f} % of the image's border is black sky", True)
    texture = float(np.mean(_gradient(frames)[:, border] > 4.0))
    plain = texture < 0.05
    still = float(np.mean(change < 4.0))
    if plain and not ordered:
        return Scene("static", "still", "photographs before a plain backdrop, which carries no texture", True)
    if still > 0.7 and ordered:
        return Scene("tumbling", "still", f"{100 * still:.0f} % of the image's border never changes", plain)
    if still > 0.9:
        return Scene("tumbling", "still", f"{100 * still:.0f} % of the image's border never changes", plain)
    return Scene("static", "moving", f"the background moves ({100 * (1 - still):.0f} % of the border changes)", plain)


def _gradient(frames: np.ndarray) -> np.ndarray:
    f = frames.astype(np.float32)
    return np.hypot(np.gradient(f, axis=2), np.gradient(f, axis=1))
