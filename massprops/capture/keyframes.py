"""Which frames to use: sharp ones, evenly spread along the way that the view has moved."""

from __future__ import annotations

import numpy as np

LEAST_MOTION = 0.004
"""Median motion of the view between two chosen frames, as a share of the image's diagonal, below which the second
adds nothing that the first did not show."""


def sharpness(grey: np.ndarray) -> float:
    """Sharpness of the textured part: 90th percentile of the local gradient over the image's own contrast.

    Args:
        grey: (h, w) uint8.
    """
    import cv2

    small = cv2.GaussianBlur(grey, (3, 3), 0).astype(np.float32)
    gradient = np.hypot(cv2.Sobel(small, cv2.CV_32F, 1, 0), cv2.Sobel(small, cv2.CV_32F, 0, 1)) / 8.0
    coarse = cv2.GaussianBlur(small, (0, 0), 6)
    contrast = np.hypot(cv2.Sobel(coarse, cv2.CV_32F, 1, 0), cv2.Sobel(coarse, cv2.CV_32F, 0, 1)) / 8.0
    return float(np.percentile(gradient, 95) / (np.percentile(contrast, 95) + 0.3))


def edge_width(grey: np.ndarray) -> float:
    """How soft the strongest edges are: standard deviation of the blur that would make them of steps [px].

    The slope of a step blurred by s falls from 1 / sqrt(s² + 1) to 1 / sqrt(s² + 16) when it is blurred by one and by
    four pixels more: the ratio gives s. A smooth surface before a dark sky has a sharp outline; a blurred one has not.

    Args:
        grey: (h, w) uint8.

    Returns:
        0 without any edge.
    """
    import cv2

    def slope(blur: float) -> np.ndarray:
        soft = cv2.GaussianBlur(grey, (0, 0), blur).astype(np.float32)
        return np.hypot(cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1))

    fine, coarse = slope(1.0), slope(4.0)
    strong = (fine >= np.percentile(fine, 99.5)) & (fine > 0)
    if not strong.any():
        return 0.0
    ratio = float(np.clip(np.median(fine[strong] / np.maximum(coarse[strong], 1e-6)), 1.001, 3.999))
    return float(np.sqrt((16 - ratio**2) / (ratio**2 - 1)))


def view_motion(before: np.ndarray, after: np.ndarray) -> float:
    """How far the texture moved: 75th percentile of tracked corners' displacement over the diagonal.

    The upper quartile follows a body that moves before a still background; where nothing can be tracked, the share
    of changed pixels stands in.

    Args:
        before, after: (h, w) uint8.
    """
    import cv2

    diagonal = float(np.hypot(*before.shape))
    corners = cv2.goodFeaturesToTrack(before, 200, 0.01, 5)
    if corners is not None and len(corners) >= 8:
        moved, tracked, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, winSize=(15, 15), maxLevel=4)
        step = np.linalg.norm((moved - corners).reshape(-1, 2), axis=1)[tracked.ravel() == 1]
        if len(step) >= 0.3 * len(corners):
            return float(np.percentile(step, 75)) / diagonal
    changed = np.mean(cv2.absdiff(before, after) > 12)
    return float(min(0.1, changed))


def choose(motion: np.ndarray, sharp: np.ndarray, most: int) -> np.ndarray:
    """Indices of the frames to use.

    The path of the view is cut into equal parts; from each part the sharpest frame near its middle is taken. Frames
    that stand still share a part, so duplicates go; frames clearly blurrier than their neighbours are avoided.

    Args:
        motion: (n,) motion from the frame before (0 for the first), as of `view_motion`.
        sharp: (n,) sharpness.
        most: largest number of frames.

    Returns:
        increasing indices, at most `most`.
    """
    n = len(motion)
    path = np.cumsum(np.concatenate([[0.0], motion[1:]]))
    if path[-1] <= 0:
        return np.array([int(np.argmax(sharp))])
    parts = int(min(most, max(2, np.floor(path[-1] / LEAST_MOTION) + 1)))
    if parts >= n:
        return _clear(np.arange(n), sharp)
    chosen: list[int] = []
    spacing = path[-1] / max(parts - 1, 1)
    for target in np.linspace(0.0, path[-1], parts):
        window = np.flatnonzero(np.abs(path - target) <= 0.35 * spacing)
        if len(window) == 0:
            window = np.array([int(np.argmin(np.abs(path - target)))])
        window = window[window > (chosen[-1] if chosen else -1)]
        if len(window) == 0:
            continue
        distance = np.abs(path[window] - target) / spacing
        chosen.append(int(window[np.argmax(sharp[window] * (1.0 - 0.5 * distance))]))
    return _clear(np.array(chosen), sharp)


def _clear(kept: np.ndarray, sharp: np.ndarray) -> np.ndarray:
    """Without the frames that are clearly blurrier than their neighbours."""
    local = np.array([np.median(sharp[kept[max(0, i - 4) : i + 5]]) for i in range(len(kept))])
    clear = sharp[kept] > 0.4 * local
    return kept[clear] if clear.sum() >= 3 else kept
