"""Black sky with something bright at the image's edge that stays, such as the limb of the Earth behind a body in orbit.

Its clouds may move, so that no picture of it is the background. Where it shines in nearly all frames silhouettes say
nothing and no features are looked for; the rest of the image is black sky.
"""

from __future__ import annotations

import numpy as np

from massprops.views import AMBIGUOUS

DARK = 40
"""Grey level below which sky is black."""
SKY = 0.5
"""Share of the image's border that must be black sky."""
FLIPS = 0.02
"""Share of the border that may go from dark to bright or back, from what it mostly is: a body that comes near the edge, and
stars, change less; a hand-held camera changes more."""
NEARLY_ALL = 10.0
"""Percentile over the frames in which it must be bright [%]."""
MARGIN = 0.012
"""Width by which the region is widened, over the image's longer side: air glows beyond the limb."""

STAR, STAR_MARGIN = 0.0005, 2.0
"""Share of the image up to which a bright spot that stays is a star, and the width by which it is widened [px]."""


def black_beside_bright(border: np.ndarray) -> float | None:
    """Share of the border that is black sky, where the rest of it is bright in all frames; None for other footage.

    Args:
        border: (n, b) grey levels of the border's pixels in n frames.
    """
    bright = border >= DARK
    usual = np.median(bright, axis=0) > 0.5
    sky = float(np.mean(~usual))
    if not SKY < sky < 1.0 or float(np.mean(bright != usual)) > FLIPS:
        return None
    return sky if np.percentile(np.median(border, axis=0)[~usual], 75) < DARK / 2 + 5 else None


def always_bright(frames: np.ndarray) -> np.ndarray:
    """(h, w) bool: what is bright in nearly all frames (n, h, w) and reaches the image's edge, or is a star."""
    import cv2

    lit = (np.percentile(frames, NEARLY_ALL, axis=0) >= DARK).astype(np.uint8)
    label, stats = cv2.connectedComponentsWithStats(lit, connectivity=8)[1:3]
    small = stats[:, cv2.CC_STAT_AREA] <= STAR * lit.size
    small[0] = False
    # what is bright about it most of the time is the middle of the body
    usual = np.median(frames, axis=0) >= DARK
    small[np.unique(label[_widened(usual & ~lit.astype(bool), STAR_MARGIN)])] = False
    wide = cv2.morphologyEx(lit, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)
    piece = cv2.connectedComponents(wide, connectivity=8)[1]
    edge = np.unique(np.concatenate([piece[0], piece[-1], piece[:, 0], piece[:, -1]]))
    return _widened(small[label], STAR_MARGIN) | _widened(np.isin(piece, edge[edge > 0]), MARGIN * max(lit.shape))


def _widened(region: np.ndarray, reach: float) -> np.ndarray:
    import cv2

    size = 2 * max(2, round(reach)) + 1
    return np.asarray(cv2.dilate(region.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def without(mask: np.ndarray, region: np.ndarray) -> np.ndarray:
    """A silhouette (h, w) that says nothing in the region (h, w)."""
    return np.where(region, np.uint8(AMBIGUOUS), mask)
