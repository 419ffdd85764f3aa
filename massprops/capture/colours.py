"""Silhouettes before a plain backdrop, corrected by the colours that all frames agree on.

One picture cannot tell a scale bar that touches the object from the object, nor a pale face from the backdrop. Over
the whole series the object's colours lie mostly inside the rough silhouettes and everything else's mostly outside,
so a histogram of both, learned again from its own answer, separates them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BINS = 24
"""Cells along each axis of CIE L*a*b*: L over 0..255, a and b over the middle 96 of OpenCV's 8-bit values."""

LEARN_AT = 480
"""Longer side at which colours are counted [px]."""

ROUNDS = 3
"""Times that colours are learned from the answer."""


@dataclass(frozen=True)
class Colours:
    """probability: (BINS**3,) that a pixel of this colour belongs to the object."""

    probability: np.ndarray

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The largest connected piece in the object's colours, small holes filled.

        Args:
            image: (h, w, 3) uint8 BGR.

        Returns:
            (h, w) bool.
        """
        return _piece(self.probability[colour_cells(image)])


def learn(images: list[np.ndarray], masks: list[np.ndarray]) -> Colours:
    """Colours of the object against all others, by their frequencies inside and outside rough silhouettes.

    Args:
        images: n of (h, w, 3) uint8 BGR.
        masks: n of (h, w), object where above 127 (or True).
    """
    import cv2

    cells: list[np.ndarray] = []
    inside: list[np.ndarray] = []
    for image, mask in zip(images, masks, strict=True):
        factor = min(1.0, LEARN_AT / max(image.shape[:2]))
        size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
        cells.append(colour_cells(cv2.resize(image, size, interpolation=cv2.INTER_AREA)))
        solid = mask.astype(np.uint8) if mask.dtype == bool else (mask > 127).astype(np.uint8)
        inside.append(cv2.resize(solid, size, interpolation=cv2.INTER_NEAREST) > 0)
    probability = _frequencies(cells, inside)
    for _ in range(ROUNDS - 1):
        inside = [_piece(probability[c]) for c in cells]
        probability = _frequencies(cells, inside)
    return Colours(probability)


def agrees(found: np.ndarray, rough: np.ndarray) -> bool:
    """Whether a corrected silhouette (h, w) is still the thing that the rough one (h, w) showed: more than half of each in the other."""
    common = np.count_nonzero(found & rough)
    return bool(2 * common > max(np.count_nonzero(found), np.count_nonzero(rough)))


def colour_cells(image: np.ndarray) -> np.ndarray:
    """(h, w) cell of each pixel's colour, of (h, w, 3) uint8 BGR."""
    import cv2

    lab = cv2.cvtColor(cv2.GaussianBlur(image, (3, 3), 0), cv2.COLOR_BGR2LAB).astype(np.int32)
    lightness = lab[..., 0] * BINS // 256
    a, b = (np.clip((lab[..., k] - 80) * BINS // 96, 0, BINS - 1) for k in (1, 2))
    return (lightness * BINS + a) * BINS + b


def _frequencies(cells: list[np.ndarray], inside: list[np.ndarray]) -> np.ndarray:
    from scipy.ndimage import gaussian_filter

    of_object = np.zeros(BINS**3)
    other = np.zeros(BINS**3)
    for cell, mask in zip(cells, inside, strict=True):
        of_object += np.bincount(cell[mask], minlength=BINS**3)
        other += np.bincount(cell[~mask], minlength=BINS**3)
    # neighbouring cells share what they know: a colour seen once is not proof
    smooth = [gaussian_filter(h.reshape((BINS,) * 3), 0.7).ravel() for h in (of_object, other)]
    return (smooth[0] / (smooth[0] + smooth[1] + 1e-3)).astype(np.float32)


def _piece(probability: np.ndarray) -> np.ndarray:
    import cv2

    scale = max(probability.shape) / 800.0
    mask = (cv2.GaussianBlur(probability, (0, 0), max(0.8, 1.5 * scale)) > 0.5).astype(np.uint8)
    for operation, width in ((cv2.MORPH_OPEN, 5), (cv2.MORPH_CLOSE, 7)):
        size = max(3, 2 * round(0.5 * (width - 1) * scale) + 1)
        mask = cv2.morphologyEx(mask, operation, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    count, label, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count <= 1:
        return mask > 0
    return without_small_gaps(label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])), 0.02)


def without_small_gaps(found: np.ndarray, share: float) -> np.ndarray:
    """A silhouette (h, w) bool with the gaps filled that are smaller than a share of it."""
    import cv2

    _, label, stats, _ = cv2.connectedComponentsWithStats((~found).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < share * found.sum()
    small[0] = False
    return np.asarray(found | small[label])
