"""Silhouettes before a sky or a background that stays: 255 object, 0 background.

An unlit side of the body looks like sky. These masks say only where something shines; the silhouettes stage marks
what may be body all the same (`massprops.capture.unknown_pixels`), and no single mask may carve.
"""

from __future__ import annotations

import numpy as np

from massprops.core.robust import MAD_TO_SIGMA
from massprops.errors import InputError
from massprops.geometry.pixels import box_about


def sky_level(frames: np.ndarray) -> tuple[float, float]:
    """Level and 1-sigma noise of a black sky, from the darker half of the border pixels of all frames.

    Args:
        frames: (n, h, w) grey, uint8 or float.
    """
    h, w = frames.shape[1:]
    band = max(2, round(0.05 * min(h, w)))
    border = np.concatenate(
        [frames[:, :band].ravel(), frames[:, -band:].ravel(), frames[:, :, :band].ravel(), frames[:, :, -band:].ravel()]
    ).astype(np.float32)
    level = float(np.median(border))
    below = border[border <= level]
    sigma = float(MAD_TO_SIGMA * np.median(level - below)) if len(below) else 0.0
    near = border[np.abs(border - level) < 12]
    return level, max(sigma, float(near.std()) if len(near) else 0.0, 0.5)


def against_sky(grey: np.ndarray, level: float, sigma: float) -> np.ndarray:
    """Lit object before black sky, by a threshold with hysteresis in units of the measured noise.

    Args:
        grey: (h, w) uint8.
        level: of the sky.
        sigma: its noise.

    Returns:
        (h, w) uint8, 255 object; stars and specks left out, holes without sky filled.
    """
    import cv2

    smooth = cv2.GaussianBlur(grey.astype(np.float32), (3, 3), 0)
    # a 3x3 Gaussian leaves 3/8 of white noise
    low, high = level + max(5.0 * 0.375 * sigma, 2.0), level + max(12.0 * 0.375 * sigma, 6.0)
    weak = (smooth > low).astype(np.uint8)
    return _solid(weak, smooth > high)


def against_background(image: np.ndarray, middle: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Object before a background that stays, by the colour difference from its median over time.

    Args:
        image: (h, w, 3) uint8.
        middle: (h, w, 3) temporal median.
        spread: (h, w, 3) temporal median absolute deviation.
    """
    import cv2

    # where the body covers a pixel most of the time the spread is its own texture, so it is bounded
    sigma = np.clip(MAD_TO_SIGMA * spread.astype(np.float32), 1.5, 6.0)
    difference = np.abs(image.astype(np.float32) - middle.astype(np.float32)) / sigma
    score = cv2.GaussianBlur(difference.max(axis=2), (5, 5), 0)
    weak = cv2.morphologyEx((score > 4.0).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    return _solid(weak, score > 8.0)


def against_plain(image: np.ndarray) -> np.ndarray:
    """Object before a plain bright or grey backdrop, by the distance in colour from the border's smooth trend.

    Args:
        image: (h, w, 3) uint8.
    """
    import cv2

    lab = cv2.cvtColor(image, cv2.COLOR_BGR2LAB).astype(np.float32)
    h, w = lab.shape[:2]
    y, x = np.mgrid[0:h, 0:w].astype(np.float32)
    x, y = x / w - 0.5, y / h - 0.5
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    band = max(3, round(0.08 * min(h, w)))
    use = np.zeros((h, w), bool)
    use[:band], use[-band:], use[:, :band], use[:, -band:] = True, True, True, True
    trend, noise = np.zeros_like(lab), np.zeros(3)
    for c in range(3):
        keep = use.copy()
        for _ in range(4):
            sample = np.flatnonzero(keep)[:: max(1, int(keep.sum()) // 20000)]
            fit, *_ = np.linalg.lstsq(terms.reshape(-1, 6)[sample], lab[..., c].ravel()[sample], rcond=None)
            trend[..., c] = terms @ fit
            residual = np.abs(lab[..., c] - trend[..., c])
            noise[c] = MAD_TO_SIGMA * np.median(residual[keep]) + 0.5
            keep = use & (residual < 3 * noise[c])
    chroma = np.hypot(lab[..., 1] - trend[..., 1], lab[..., 2] - trend[..., 2])
    # a shadow darkens the backdrop by less than half and leaves its colour
    shade = 1.0 - lab[..., 0] / np.maximum(trend[..., 0], 1.0)
    score = np.maximum(chroma / (6.0 * noise[1:].max() + 9.0), shade / 0.38)
    score = cv2.GaussianBlur(score, (5, 5), 0)
    return _largest(_solid((score > 1.0).astype(np.uint8), score > 1.25))


def _largest(mask: np.ndarray) -> np.ndarray:
    """The largest piece, cut from what only touches it (a scale bar, a cast shadow's rim)."""
    import cv2

    size = max(3, round(0.012 * max(mask.shape)) | 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    core = cv2.erode(mask, kernel)
    count, label, stats, _ = cv2.connectedComponentsWithStats((core > 0).astype(np.uint8), connectivity=8)
    if count <= 1:
        return mask
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    grown = cv2.dilate(
        (label == best).astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size + 4, size + 4))
    )
    return np.where((grown > 0) & (mask > 0), 255, 0).astype(np.uint8)


def _solid(weak: np.ndarray, strong: np.ndarray) -> np.ndarray:
    """Components of `weak` (h, w) uint8 that hold enough of `strong` (h, w) bool; specks go, small holes are filled."""
    out = np.zeros(weak.shape, np.uint8)
    if strong.any():
        about = box_about(weak)
        out[about] = _solid_within(weak[about], strong[about])
    return out


def _solid_within(weak: np.ndarray, strong: np.ndarray) -> np.ndarray:
    """The same in a box that leaves a pixel about `weak`, unless it touches the image's border."""
    import cv2

    count, label, stats, _ = cv2.connectedComponentsWithStats(weak, connectivity=8)
    if count <= 1:
        return np.zeros(weak.shape, np.uint8)
    support = np.bincount(label[strong], minlength=count)
    area = stats[:, cv2.CC_STAT_AREA]
    total = max(int(area[1:].max()), 1)
    keep = (support >= 4) & (area > max(12, 0.004 * total))
    keep[0] = False
    mask: np.ndarray = keep[label].astype(np.uint8) * 255
    count, label, stats, _ = cv2.connectedComponentsWithStats((mask == 0).astype(np.uint8), connectivity=4)
    for i in range(1, count):
        x, y, w, h, size = stats[i]
        inside = x > 0 and y > 0 and x + w < mask.shape[1] and y + h < mask.shape[0]
        if inside and size < 0.0005 * total:
            mask[label == i] = 255
    return mask


def main_object(masks: list[np.ndarray], what: str) -> str | None:
    """Looks for a second body of like size, apart from the first in most frames.

    Args:
        masks: silhouettes (h, w) spread over the footage.
        what: the footage's name, for the message.

    Returns:
        None when there is one object; a warning when there may be a small second one.

    Raises:
        InputError: two or more bodies that stay apart.
    """
    import cv2

    apart = second_seen = 0
    lit = [m for m in masks if (m == 255).any()]
    for mask in lit:
        count, label, stats, centre = cv2.connectedComponentsWithStats((mask == 255).astype(np.uint8), connectivity=8)
        if count < 3:
            continue
        first, second = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA])[:2]
        share = stats[second, cv2.CC_STAT_AREA] / stats[first, cv2.CC_STAT_AREA]
        if share < 0.05:
            continue
        distance = cv2.distanceTransform((label != first).astype(np.uint8), cv2.DIST_L2, 3)
        gap = float(distance[label == second].min())
        extent = float(np.hypot(*stats[first, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]))
        # parts of one body are joined by what lies in its shadow, so they are near each other
        if gap > 0.25 * extent:
            second_seen += 1
            apart += share >= 0.2
    if lit and apart > 0.6 * len(lit):
        raise InputError(
            f"{what}: several objects are in view in {apart} of the {len(lit)} frames looked at; crop to one, or give its "
            "silhouettes with --masks"
        )
    if lit and second_seen > 0.6 * len(lit):
        return f"a second, smaller thing is in view in {second_seen} of {len(lit)} frames looked at; give --masks to leave it out"
    return None
