"""Silhouette of a still object by GrabCut, seeded by where the reconstruction projects."""

from __future__ import annotations

import numpy as np

WORK = 480
"""Longer side at which colours are separated [px]; edges are then refined at full size."""


def cut_out(image: np.ndarray, body: np.ndarray, surely: np.ndarray, away: np.ndarray, rounds: int = 4) -> np.ndarray:
    """Object against the rest.

    Args:
        image: (h, w, 3) uint8.
        body: (h, w) bool, where object probably is.
        surely: (h, w) bool, object points.
        away: (h, w) bool, certainly not object.
        rounds: GrabCut iterations.

    Returns:
        (h, w) uint8, 255 object; pieces without a sure point are dropped.
    """
    import cv2

    h, w = body.shape
    factor = min(1.0, WORK / max(h, w))
    size = (round(w * factor), round(h * factor))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)

    def reduced(mask: np.ndarray) -> np.ndarray:
        return cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)

    label = np.full(size[::-1], cv2.GC_PR_BGD, np.uint8)
    label[reduced(body) > 0.5] = cv2.GC_PR_FGD
    label[reduced(away) > 0.5] = cv2.GC_BGD
    label[reduced(surely) > 0.02] = cv2.GC_FGD
    if not (label == cv2.GC_FGD).any() or not (label == cv2.GC_BGD).any():
        return np.where(body, 255, 0).astype(np.uint8)
    cv2.setRNGSeed(0)
    cv2.grabCut(small, label, None, np.zeros((1, 65)), np.zeros((1, 65)), rounds, cv2.GC_INIT_WITH_MASK)
    found = ((label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)).astype(np.uint8)
    found = cv2.morphologyEx(found, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, piece, _, _ = cv2.connectedComponentsWithStats(found, connectivity=8)
    sure = np.bincount(piece[reduced(surely) > 0.02], minlength=count)
    keep = sure >= max(3, 0.03 * sure[1:].max(initial=0))
    keep[0] = False
    mask = keep[piece].astype(np.float32)
    return np.where(cv2.resize(mask, (w, h), interpolation=cv2.INTER_LINEAR) > 0.5, 255, 0).astype(np.uint8)
