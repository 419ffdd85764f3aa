"""Silhouettes before a black sky that end where the body's lit edges do.

A threshold just above the sky takes in what optics, pixels and video spread of an edge, and where structure from motion has put points beside an
edge, sky is called unknown (`massprops.capture.unknown_pixels`). Both make a hull wider, on all sides alike: of two bodies in foil (Blender) it
ended 4 to 5 px beyond their ends, which made them 2 % too long.

An edge lies where brightness falls to half, and what lies beyond it is no object. Where the rim of unknown pixels about a silhouette is
narrow, it is sky, but not behind what is lit, as the Sun shines, nor where a side was measured that turns away from it: the dark half of a thin
boom is as narrow.
"""

from __future__ import annotations

import numpy as np

from massprops.geometry.pixels import box_about, grown
from massprops.geometry.projection import pixels_of
from massprops.surface.cloud import Cloud
from massprops.surface.space_carving import LIT
from massprops.surface.unlit import towards_in_image
from massprops.views import AMBIGUOUS, Views

HALF = 0.5
"""Of the brightest pixel within `SPREAD` of it, what a pixel is less than beyond an edge. Images keep brightness by a power of about 1 / 2.2: half of it is a
pixel that the body covers to a fifth, and one that it covers to a half stays."""
SPREAD, DEEPEST = 2, 2.5
"""How far an edge is spread, and how deep beyond it a silhouette may reach, both in pixels; the profiles of foil 79, 81 and 85 (Blender, H.264) fall to the sky
within 2 to 3. A dark rim of the body's own that is wider is not cut."""
BRIGHT = 30
"""Level of a bright edge, of 255. Where light fades over many pixels, as at a terminator, half of it is no edge."""
RIM = 6
"""Width of a rim of unknown pixels up to which it is that of points beside an edge [px]: theirs was 4 to 5 on foil 79 and 81, and an unlit side is wider in most
images. Set on these two."""
BESIDE = 2
"""About a measured side that turns away from the Sun, so far on all sides sky stays unknown [px]."""


def sharp_outlines(
    views: Views,
    masks: list[np.ndarray],
    skies: list[np.ndarray],
    grey: list[np.ndarray],
    cloud: Cloud,
    towards: np.ndarray,
) -> list[np.ndarray]:
    """Silhouettes (h, w) of a body before a black sky, cut at its lit edges.

    Args:
        views: n cameras; masks: n undistorted silhouettes, 255 object, 0 sky, 128 no evidence.
        skies: n images (h, w) bool, pixels that are as dark as the sky; grey: n undistorted images (h, w) uint8.
        cloud: measured points.
        towards: (n, 3) to the Sun, in each view's camera.
    """
    sun = np.einsum("nji,nj->ni", views.R, towards)
    in_image = towards_in_image(views, cloud, towards)
    out = []
    for i, mask in enumerate(masks):
        if not (mask == 255).any():
            out.append(mask)
            continue
        away = _turned_away(cloud, views, i, sun[i], mask.shape)
        about = box_about((mask != 0).astype(np.uint8), RIM + 2)
        cut = mask.copy()
        cut[about] = _cut(mask[about], skies[i][about], grey[i][about], away[about], in_image[i])
        out.append(cut)
    return out


def _turned_away(cloud: Cloud, views: Views, i: int, sun: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(h, w) bool: pixels of measured points that look at view i and not at the Sun, which is in direction `sun` (3,) in the world."""
    sight = views.centres[i] - cloud.xyz
    dark = (np.einsum("ij,ij->i", cloud.normal, sight) > 0) & (cloud.normal @ sun < LIT)
    _, rows, columns = pixels_of(cloud.xyz[dark], views.K[i], views.R[i], views.t[i], shape)
    out = np.zeros(shape, bool)
    out[rows, columns] = True
    return out


def _cut(mask: np.ndarray, sky: np.ndarray, grey: np.ndarray, away: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """One silhouette (h, w) cut at its lit edges; away (h, w) bool: pixels of measured sides that turn away from the Sun, which is in
    direction `towards` (2,) in the image."""
    import cv2

    beyond = _beyond_edge(mask == 255, sky, grey)
    shown = (mask == 255) & ~beyond
    unknown = beyond | ((mask != 0) & (mask != 255) & sky)
    from_shown = cv2.distanceTransform((~shown).astype(np.uint8), cv2.DIST_L2, 5)
    stays = grown(unknown & (from_shown > RIM), RIM + 1) | grown(away, BESIDE) | _close_behind(shown, towards)
    return np.where(unknown & ~stays, np.uint8(0), np.where(beyond, np.uint8(AMBIGUOUS), mask))


def _beyond_edge(shown: np.ndarray, sky: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels of a silhouette that a bright edge beside them spreads to."""
    import cv2

    brightest = cv2.dilate(np.where(shown, grey, np.uint8(0)), np.ones((2 * SPREAD + 1,) * 2, np.uint8))
    depth = cv2.distanceTransform((~sky).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(shown & (depth <= DEEPEST) & (grey < HALF * brightest) & (brightest > BRIGHT))


def _close_behind(shown: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels from which something shown lies within `RIM` in the direction `towards` (2,)."""
    import cv2

    out, step = np.zeros(shown.shape, bool), towards / max(float(np.linalg.norm(towards)), 1e-12)
    for k in range(1, RIM + 1):
        move = np.column_stack([np.eye(2), -k * step])
        out |= cv2.warpAffine(shown.astype(np.uint8), move, shown.shape[::-1], flags=cv2.INTER_NEAREST) > 0
    return out
