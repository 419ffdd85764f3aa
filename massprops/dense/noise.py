"""Noise of images on the object: how much there is, and taking it out where it hides the texture."""

from __future__ import annotations

import numpy as np

NOISY, DENOISING_SIGMA = 12.0, 1.0
"""Noise from which on an image is blurred before it is matched [grey levels], and the blur [px]. Images of a spacecraft without
noise, whose fine texture counts as some, have 9 to 10; with 14 levels of noise 15 to 18."""
LEFT = 0.282
"""Share of white noise that such a blur leaves."""


def image_noise(grey: np.ndarray, own: np.ndarray) -> float:
    """1-sigma of the noise of an image (h, w) on its object (h, w) bool [grey levels] (Immerkaer 1996); fine texture is taken
    for some of it. 0 where there is no object."""
    import cv2

    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    response = np.abs(cv2.filter2D(grey.astype(np.float32), cv2.CV_32F, kernel))[own]
    # texture widens the response; the lower quartile of |N(0, 6 sigma)| lies at 0.3186 * 6 sigma
    return float(np.percentile(response, 25)) / (0.3186 * 6.0) if len(response) else 0.0


def denoised(grey: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, float]:
    """An image (h, w) float32 with its noise taken out where there is much, and the noise that is left [grey levels]."""
    import cv2

    noise = image_noise(grey, mask > 0)
    if noise <= NOISY:
        return grey, _usable(noise, mask)
    return cv2.GaussianBlur(grey, (0, 0), DENOISING_SIGMA), LEFT * noise


def grey_noise(grey: np.ndarray, mask: np.ndarray) -> float:
    """1-sigma of pixel noise of an image (h, w) on the object, a mask (h, w), within what matching makes use of [grey levels]."""
    return _usable(image_noise(grey, mask > 0), mask)


def _usable(noise: float, mask: np.ndarray) -> float:
    return float(np.clip(noise, 0.5, 8.0)) if (mask > 0).any() else 1.0
