"""Tells the two kinds of footage apart: a body that moves before a still camera, or a camera round a still object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.capture.limb import DARK, black_beside_bright

CHANGED = 12
"""Difference of grey levels by which a pixel of the border has changed, beyond noise and flicker."""
MOVED, STAYED = 0.25, 0.1
"""Share of the border that changes when the camera is moved, and that may change while it stays. A rendered turntable
before a room: 0.79 at the move, 0.009 at most otherwise; a hand-held video: 0.60 in the median."""
STAYS = 5
"""Frames on either side of a move in which the camera must stay."""


@dataclass(frozen=True)
class Scene:
    """motion: tumbling or static; background: black, still or moving; reason: one sentence; plain: no texture in it."""

    motion: str
    background: str
    reason: str
    plain: bool


def judge(frames: np.ndarray, ordered: bool, place: np.ndarray | None = None) -> Scene:
    """The kind of footage, from what the border of the image does.

    Args:
        frames: (n, h, w) uint8, small grey frames spread over the footage.
        ordered: whether they follow each other in time (video) or are single photographs.
        place: (n,) of `camera_places`; one place by default.
    """
    border = _border(frames)
    values = frames[:, border].astype(np.float32)
    place = np.zeros(len(frames), int) if place is None else place
    off = np.empty_like(values)
    for k in np.unique(place):
        off[place == k] = values[place == k] - np.median(values[place == k], axis=0)
    middle = np.median(values, axis=0)
    change = np.median(np.abs(off), axis=0)
    dark = float(np.mean(middle < DARK))
    if dark > 0.85 and np.percentile(middle, 75) < DARK / 2 + 5:
        return Scene("tumbling", "black", f"{100 * dark:.0f} % of the image's border is black sky", True)
    beside = black_beside_bright(values)
    if beside is not None:
        reason = f"{100 * beside:.0f} % of the image's border is black sky, and the rest is bright throughout"
        return Scene("tumbling", "black", reason, True)
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


def camera_places(frames: np.ndarray) -> np.ndarray:
    """(n,) int, where a camera that stands still stood in each frame of a video: 0, 1, ... from one move to the next.

    A tripod is moved, or raised, in the middle of a video: before and after it the border stays, across it most of the
    border changes at once. A hand-held camera never stays, and has one place.

    Args:
        frames: (n, h, w) uint8, small grey frames in time order.
    """
    values = frames[:, _border(frames)].astype(np.int16)
    changed = np.mean(np.abs(np.diff(values, axis=0)) > CHANGED, axis=1)
    place = np.zeros(len(frames), int)
    for i in np.flatnonzero(changed > MOVED):
        around = np.concatenate([changed[max(0, i - STAYS) : i], changed[i + 1 : i + 1 + STAYS]])
        if i + 1 >= STAYS and len(frames) - (i + 1) >= STAYS and np.all(around < STAYED):
            place[i + 1 :] += 1
    return place


def _border(frames: np.ndarray) -> np.ndarray:
    h, w = frames.shape[1:]
    band = max(2, round(0.06 * min(h, w)))
    border = np.ones((h, w), bool)
    border[band:-band, band:-band] = False
    return border


def _gradient(frames: np.ndarray) -> np.ndarray:
    f = frames.astype(np.float32)
    return np.hypot(np.gradient(f, axis=2), np.gradient(f, axis=1))
