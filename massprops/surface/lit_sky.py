"""Sky beside a body of which one side alone is lit: evidence only where the body would be lit.

A pixel as dark as the sky shows no body there, or a side that the Sun does not reach. Stereo measures a side when it is lit, and
in other images sees sky there: of a CubeSat that turned half of its sides away, up to a third of the images said that measured
points are not there. A hull that is held back for their sake carves nothing where they are right, and what was never measured, such as
a white end, all the same.

Where the body would be lit follows from its shape. So the largest shape that the sky allows is found first
(`massprops.surface.space_carving`): within the sky that counts in any case (towards the Sun from all that is lit,
`massprops.surface.unlit.spare_behind_light`), without all that would be lit where images show sky. Sides of it that turn away from the
Sun or lie in its shadow take the sky before them out of the evidence. From a shape that is too small one does not come back: in a
crater that was carved by mistake there are walls which would be lit.
"""

from __future__ import annotations

import numpy as np

from massprops.geometry.rasterise import rasterise
from massprops.surface.cloud import Cloud
from massprops.surface.refine import vertex_normals
from massprops.surface.shadow import IN_SHADOW, behind_first
from massprops.surface.silhouette import make_hull
from massprops.surface.space_carving import LIT, carved
from massprops.surface.unlit import spare_behind_light
from massprops.views import AMBIGUOUS, Views

WIDER = 2
"""How well outlines are known [px]: so far beyond an unlit side sky is no evidence, and so far beside a silhouette it does not show that a lit side
is missing."""


def sky_where_lit(
    views: Views, masks: list[np.ndarray], grey: list[np.ndarray], cloud: Cloud, towards: np.ndarray
) -> list[np.ndarray]:
    """Silhouettes (h, w) of a body before a black sky in which sky is 128, no evidence, where the body would not be lit.

    Args:
        views, masks, grey, cloud: as for `massprops.surface.unlit.spare_unlit`; towards: (n, 3) to the Sun, in each view's camera.
    """
    measured = cloud.xyz[cloud.is_finite]
    hull = make_hull(views, spare_behind_light(views, masks, grey), measured, free=True)
    sky = [~_widened(mask != 0) for mask in masks]
    vertices, faces, step = carved(views, sky, towards, hull, measured)
    return spare_where_unlit(views, masks, (vertices, faces), towards, step)


def spare_where_unlit(
    views: Views, masks: list[np.ndarray], mesh: tuple[np.ndarray, np.ndarray], towards: np.ndarray, spacing: float
) -> list[np.ndarray]:
    """Silhouettes (h, w) in which sky is 128 before the sides of a mesh that no light reaches.

    Args:
        mesh: vertices (v, 3) and faces (f, 3), in the views' world, with edges of length `spacing`.
        towards: (n, 3) to the Sun, in each view's camera.
    """
    vertices, faces = mesh
    normal = vertex_normals(vertices, faces)
    out = []
    for i, mask in enumerate(masks):
        sun = views.R[i].T @ towards[i]
        dark = (normal @ sun < LIT) | (behind_first(vertices, faces, sun) > IN_SHADOW * spacing)
        face = rasterise(vertices, faces, views.K[i], views.R[i], views.t[i], mask.shape[::-1])[1]
        unlit = (face >= 0) & (dark[faces].sum(axis=1) >= 2)[face]
        out.append(np.where((mask == 0) & _widened(unlit), np.uint8(AMBIGUOUS), mask))
    return out


def _widened(where: np.ndarray) -> np.ndarray:
    """(h, w) bool, grown by `WIDER` on all sides."""
    import cv2

    return cv2.dilate(where.astype(np.uint8), np.ones((2 * WIDER + 1,) * 2, np.uint8)) > 0
