"""The unlit side of a rounded body, which a threshold against black sky calls sky.

In the image the unlit side of a convex body continues its lit side, away from the Sun. Along a line of that direction a
ball at phase angle a shows a lit chord and then an unlit one, tan^2(a / 2) times as long: there, sky is no evidence. A
body of flat facets ends where its light does; it is told apart by the brightness along the chords, which fades as the
ball's (Lambert's law) or does not.

The Sun stands still before a still camera, or each of a rig's, and its direction follows from the brightness of the measured points:
linear in their normals.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.surface.cloud import Cloud
from massprops.views import AMBIGUOUS, Views, entries

ROUNDED = 0.75
"""Share of chords that must look rounded: half of them are, when of flat ones chance makes half look so."""
AGREED = 0.5
"""Length of the sum of all images' slopes of brightness over the sum of their lengths from which on they agree; of random ones it is
next to 0."""
SHORTEST = 8
"""Chords shorter than this say nothing [px]."""


def spare_unlit(
    views: Views, masks: list[np.ndarray], grey: list[np.ndarray], cloud: Cloud, sun: np.ndarray
) -> list[np.ndarray]:
    """Silhouettes (h, w) of a tumbling body in which sky behind its terminator is 128, no evidence.

    Args:
        views: n views of still cameras, in the body's frame; each camera's are named by a folder of their own.
        masks: n undistorted silhouettes, 255 object and 0 sky.
        grey: n undistorted images (h, w) uint8.
        cloud: measured points.
        sun: (n, 3) direction to it in each view's camera, of `sun_of_views`.

    Returns:
        the silhouettes as they are where the body is not rounded.
    """
    middle = cloud.xyz.mean(0) @ views.R.transpose(0, 2, 1) + views.t
    phase = np.clip(-np.einsum("ni,ni->n", middle, sun) / np.linalg.norm(middle, axis=1), -0.9, 1.0)
    towards = towards_in_image(views, cloud, sun)
    some = range(0, len(masks), max(1, len(masks) // 24))
    votes = np.concatenate([_looks_rounded(masks[i], grey[i], towards[i], phase[i]) for i in some])
    if not len(votes) or votes.mean() <= ROUNDED:
        return masks
    return [_spare(*one) for one in zip(masks, towards, (1 - phase) / (1 + phase), strict=True)]


def spare_behind_light(views: Views, masks: list[np.ndarray], grey: list[np.ndarray]) -> list[np.ndarray]:
    """Silhouettes (h, w) in which sky is no evidence, 128, wherever something lit lies towards the Sun from it.

    What is unlit turns away from the Sun, or lies in the shadow of what is lit: seen along the Sun's direction in the image, it
    is behind that. So the outline that faces the Sun is the body's own whatever its shape, and each side of a tumbling body
    faces the Sun in some images. That leaves half of the evidence, which is enough where outlines are all there is.

    Args:
        views, masks, grey: as for `spare_unlit`.

    Returns:
        the silhouettes as they are where the brightness does not tell the Sun's direction.
    """
    out = list(masks)
    for camera_views in _of_each_camera(views):
        towards = brighter([masks[i] for i in camera_views], [grey[i] for i in camera_views])
        if towards is None:
            return masks
        for i in camera_views:
            behind = _behind_any(masks[i] == 255, towards)
            out[i] = np.where((masks[i] == 0) & behind, np.uint8(AMBIGUOUS), masks[i])
    return out


def _of_each_camera(views: Views) -> list[np.ndarray]:
    """The places of each camera's views."""
    folder = views.folders
    return [np.flatnonzero(folder == camera) for camera in np.unique(folder)]


def brighter(masks: list[np.ndarray], grey: list[np.ndarray]) -> np.ndarray | None:
    """(2,) unit, direction in the image in which the object gets brighter, over all images of a body that turns before a still
    camera; None where they do not agree. A wrong shape of the body does not matter to it."""
    slopes = []
    for mask, image in zip(masks, grey, strict=True):
        at = np.argwhere(mask == 255)[:, ::-1].astype(float)
        if len(at) < SHORTEST**2:
            continue
        light = image[mask == 255].astype(float)
        at -= at.mean(axis=0)
        slope = np.linalg.lstsq(at, light - light.mean(), rcond=None)[0]
        slopes.append(slope)
    total = np.sum(slopes, axis=0) if slopes else np.zeros(2)
    length, path = float(np.linalg.norm(total)), float(np.linalg.norm(np.reshape(slopes, (-1, 2)), axis=1).sum())
    return np.asarray(total / length) if length > AGREED * max(path, 1e-12) else None


def _behind_any(lit: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels from which something lit lies in the direction `towards` (2,)."""
    import cv2

    h, w = lit.shape
    x, y = -towards / np.linalg.norm(towards)
    turn = np.array([[x, y], [-y, x]])
    size = 2 * int(np.ceil(np.hypot(h, w) / 2)) + 2
    move = np.column_stack([turn, np.full(2, size / 2) - turn @ [(w - 1) / 2, (h - 1) / 2]])
    rows = cv2.warpAffine(np.uint8(lit), move, (size, size), flags=cv2.INTER_NEAREST)
    behind = np.maximum.accumulate(rows, axis=1)
    back = cv2.warpAffine(behind, move, (w, h), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    return np.asarray(back > 0)


def towards_in_image(views: Views, cloud: Cloud, sun: np.ndarray) -> np.ndarray:
    """(n, 2) direction in each image from the middle of measured points to the Sun, which is in direction `sun` (n, 3) in the cameras."""
    middle = cloud.xyz.mean(0) @ views.R.transpose(0, 2, 1) + views.t
    return np.asarray(sun[:, :2] - middle[:, :2] / middle[:, 2:] * sun[:, 2:])


def sun_of_views(views: Views, grey: list[np.ndarray], cloud: Cloud, seed: int) -> np.ndarray | None:
    """(n, 3) direction to the Sun in each view's camera, which stands still; None where one's brightness does not say."""
    out = np.zeros((len(views), 3))
    for camera_views in _of_each_camera(views):
        number = np.full(len(views), -1)
        number[camera_views] = np.arange(len(camera_views))
        sun = sun_direction(views.take(camera_views), [grey[i] for i in camera_views], cloud.of_views(number), seed)
        if sun is None:
            return None
        out[camera_views] = sun
    return out


def sun_direction(views: Views, grey: list[np.ndarray], cloud: Cloud, seed: int = 0) -> np.ndarray | None:
    """(3,) unit, in camera axes, towards the Sun; None where the brightness does not say."""
    rng = np.random.default_rng([seed, 15])
    pick = np.sort(rng.permutation(len(cloud))[:20_000])
    which, place = entries(cloud.view_start, pick)
    point, view = pick[which], cloud.view_index[place]
    seen = np.einsum("nij,nj->ni", views.R[view], cloud.xyz[point]) + views.t[view]
    pixel = np.rint(np.einsum("nij,nj->ni", views.K[view], seen / seen[:, 2:])[:, :2]).astype(int)
    size = np.array([g.shape[::-1] for g in grey])[view]
    pixel = np.clip(pixel, 0, size - 1)
    light = np.array([grey[v][y, x] for v, (x, y) in zip(view, pixel, strict=True)], float)
    normal = np.einsum("nij,nj->ni", views.R[view], cloud.normal[point])
    design = np.column_stack([normal, np.ones(len(normal))])
    weight = (light > 0).astype(float)
    if weight.sum() < 100:
        return None
    coefficients = np.zeros(4)
    for _ in range(10):
        coefficients = np.linalg.lstsq(design * weight[:, None], light * weight, rcond=None)[0]
        off = light - design @ coefficients
        scale = mad_sigma(off[light > 0])
        weight = (light > 0) / np.sqrt(1 + (off / max(2 * scale, 1e-9)) ** 2)
    length = float(np.linalg.norm(coefficients[:3]))
    return coefficients[:3] / length if length > 0 else None


def _turned(
    mask: np.ndarray, towards: np.ndarray, beyond: float = 0.0
) -> tuple[np.ndarray, np.ndarray, tuple[Any, ...]]:
    """The object (r, c) bool in a window about it whose rows run away from the Sun, with `beyond` of its width more.

    Also the (2, 3) map into the window, and its size for OpenCV.
    """
    import cv2

    x, y = -towards / np.linalg.norm(towards)
    turn = np.array([[x, y], [-y, x]])
    at = turn @ np.stack(np.nonzero(mask == 255))[::-1]
    low = at.min(1) - 1
    width, height = np.ceil(at.max(1) - low).astype(int) + 2
    size = (int(width + np.ceil(beyond * width)), int(height))
    move = np.column_stack([turn, -low])
    return cv2.warpAffine(np.uint8(mask == 255), move, size, flags=cv2.INTER_NEAREST) > 0, move, size


def _looks_rounded(mask: np.ndarray, grey: np.ndarray, towards: np.ndarray, phase: float) -> np.ndarray:
    """(k,) bool for each chord: its brightness follows a ball's better than it stays the same; phase as a cosine."""
    import cv2

    if not (mask == 255).any():
        return np.zeros(0, bool)
    lit, move, size = _turned(mask, towards)
    light = cv2.warpAffine(grey, move, size)[::2].astype(float)
    lit = lit[::2]
    first, last = lit.argmax(1), size[0] - 1 - lit[:, ::-1].argmax(1)
    long = lit.any(1) & (last - first >= SHORTEST)
    lit, light, first, last = lit[long], light[long], first[long], last[long]
    t = (last[:, None] + 0.5 - np.arange(size[0])) / (last - first + 1)[:, None]
    p = np.clip(t * (1 + phase) - phase, -1, 1)
    ball = np.where(lit, p * np.sqrt(1 - phase**2) + np.sqrt(1 - p * p) * phase, 0.0)
    light = np.where(lit, light, 0.0)
    # both have one free factor: the better one leaves less
    as_ball = (light * ball).sum(1) ** 2 / np.maximum((ball**2).sum(1), 1e-9)
    as_plate = light.sum(1) ** 2 / np.maximum(lit.sum(1), 1)
    return np.asarray(as_ball > as_plate)


def _spare(mask: np.ndarray, towards: np.ndarray, ratio: float) -> np.ndarray:
    """The silhouette with `ratio` of each chord's length as no evidence behind it."""
    import cv2

    if not (mask == 255).any():
        return mask
    lit, move, size = _turned(mask, towards, ratio)
    whole = lit
    # a dark gap no longer than the unlit part belongs to one chord
    for _ in range(3):
        behind, gap = _behind(whole, ratio)
        whole = whole | gap
    unlit = np.uint8((whole | behind) & ~lit)
    back = cv2.warpAffine(unlit, move, mask.shape[::-1], flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) > 0
    return np.where((mask == 0) & back, np.uint8(AMBIGUOUS), mask)


def _behind(lit: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """What lies within `ratio` of each lit run's length behind it, and the gaps that do so as a whole."""
    column = np.arange(lit.shape[1], dtype=np.int32)
    last = np.maximum.accumulate(np.where(lit, column, -1), axis=1)
    before = np.maximum.accumulate(np.where(lit, -1, column), axis=1)
    reach = ratio * (last - np.take_along_axis(before, np.maximum(last, 0), axis=1))
    after = np.minimum.accumulate(np.where(lit, column, 2 * lit.shape[1])[:, ::-1], axis=1)[:, ::-1]
    dark = ~lit & (last >= 0)
    return dark & (column - last <= reach), dark & (after - last - 1 <= reach)
