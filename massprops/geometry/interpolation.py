"""What images and curves are between their samples."""

from __future__ import annotations

import numpy as np


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Values (n,) or (n, c) of an image (h, w) or (h, w, c) at places (n, 2), between the four pixels about each."""
    import cv2

    # OpenCV maps at most 32767 rows at once
    parts = np.array_split(uv.astype(np.float32), len(uv) // 30_000 + 1)
    return np.concatenate(
        [cv2.remap(image, part[None, :, 0].copy(), part[None, :, 1].copy(), cv2.INTER_LINEAR)[0] for part in parts]
    )


def peak(left: np.ndarray, middle: np.ndarray, right: np.ndarray) -> np.ndarray:
    """How far beyond the middle one of three even samples (...), the largest, a parabola through them is highest [steps]; 0 where they are
    the same."""
    bow = np.asarray(2 * middle - left - right, float)
    return 0.5 * np.asarray(right - left, float) / np.where(bow > 0, bow, np.inf)
