"""What stands behind a body in orbit: stars, and the Earth's bright limb."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

Backdrop = Callable[[int, np.ndarray], np.ndarray]
"""What is behind the body in frame i, from the black sky (h, w) in grey levels."""


def stars_and_limb(size: tuple[int, int], seed: int) -> Backdrop:
    """Stars that stand still, and the Earth's bright limb below, whose clouds move on.

    Args:
        size: width and height [px].
        seed: of the stars and the clouds.
    """
    w, h = size
    rng = np.random.default_rng([seed, 5])
    stars = np.zeros((h, w), np.float32)
    count = w * h // 900
    stars[rng.integers(0, h, count), rng.integers(0, w, count)] = rng.exponential(250.0, count)
    stars = cv2.GaussianBlur(stars, (0, 0), 0.7)
    rows, columns = np.mgrid[0:h, 0:w].astype(np.float32)
    radius = 2.2 * w
    depth = radius - np.hypot(columns - 0.3 * w, rows - (0.86 * h + radius))
    clouds = cv2.GaussianBlur(rng.standard_normal((h, 4 * w)).astype(np.float32), (0, 0), 0.03 * w)
    clouds = 130.0 + 45.0 * clouds / clouds.std()

    def behind(i: int, black: np.ndarray) -> np.ndarray:
        shift = round(i * 0.01 * w) % (3 * w)
        edge = np.clip(depth / 4.0, 0.0, 1.0)
        return np.clip((black + stars) * (1 - edge) + edge * clouds[:, shift : shift + w], 0, 255)

    return behind
