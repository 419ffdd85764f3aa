"""The points that the user points at, by a pixel or a rectangle of an image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprops.capture.choice import Located
from massprops.capture.scene import Scene, seen_in
from massprops.errors import NotPossible

NEAR_PX = (3.0, 6.0, 12.0)
"""Distances from the pixel pointed at within which points are looked for, one after the other [px]."""
DEEP = 0.05
"""Points this much farther than the nearest, in radii of the region, lie behind it."""


def chosen_points(scene: Scene, piece: np.ndarray, pointed: Sequence[Located]) -> np.ndarray:
    """(n,) bool: the points that the user points at; piece (n,) of `label_pieces`."""
    member = np.zeros(len(piece), bool)
    for one in pointed:
        if one.pointed.is_box:
            member |= _in_box(scene, piece, one)
        else:
            member |= piece == piece_at(scene, piece, one)
    return member


def piece_at(scene: Scene, piece: np.ndarray, at: Located) -> int:
    """The piece that a pixel shows.

    Args:
        scene: the points; piece: (n,) of `label_pieces`.
        at: the pixel.

    Raises:
        NotPossible: it shows the support or nothing that was measured.
    """
    uv, z = seen_in(scene, at.view)
    away = np.hypot(*(uv - at.uv[0]).T)
    deep = DEEP * scene.region.radius
    front = 0
    for radius in NEAR_PX:
        near = np.flatnonzero(away < radius)
        if len(near) < 3:
            continue
        front = int(np.bincount(piece[near[z[near] < np.nanmin(z[near]) + deep]]).argmax())
        if front:
            return front
        break
    covers = [(np.nanmedian(z[piece == k]), k) for k in _outlines(piece, uv, at)]
    if covers:
        return min(covers)[1]
    what = "shows the background or what the object stands on"
    raise NotPossible(
        f"{at.pointed.option}: that pixel of {at.name} {what}: give a pixel on the object, or a rectangle round it "
        "with --box"
    )


def _outlines(piece: np.ndarray, uv: np.ndarray, at: Located) -> list[int]:
    """Pieces within whose convex outline the pixel lies: glossy and plain sides have no points of their own."""
    import cv2

    enclosing_pieces = []
    for k in np.unique(piece[piece > 0]):
        piece_pixels = uv[piece == k]
        piece_pixels = piece_pixels[np.isfinite(piece_pixels).all(1)]
        if len(piece_pixels) < 20:
            continue
        outline = cv2.convexHull(piece_pixels.astype(np.float32))
        if cv2.pointPolygonTest(outline, tuple(float(v) for v in at.uv[0]), False) >= 0:
            enclosing_pieces.append(int(k))
    return enclosing_pieces


def _in_box(scene: Scene, piece: np.ndarray, at: Located) -> np.ndarray:
    """(n,) bool: the largest thing that lies in a rectangle of one view, and its other large parts there."""
    uv, _ = seen_in(scene, at.view)
    low, high = at.uv.min(0), at.uv.max(0)
    inside = (piece > 0) & ((uv >= low) & (uv <= high)).all(1)
    count, whole = (np.bincount(piece[m], minlength=piece.max() + 1) for m in (inside, piece > 0))
    if not inside.any() or count.max() < 20:
        raise NotPossible(
            f"{at.pointed.option}: nothing that rises from its support was measured in that rectangle of {at.name}: "
            "draw it round the object"
        )
    # what lies behind the object shows a part only
    mostly = (count > 0.6 * np.maximum(whole, 1)) & (count >= 0.1 * count.max())
    mostly[int(count.argmax())] = True
    return inside & mostly[piece]
