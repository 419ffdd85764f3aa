"""Unmeasured sides brought out to where the silhouettes end.

A side that nothing was measured on lies somewhere between the silhouettes' hull and a membrane over the measured rims. Where it
is on the mesh's outline in some view, that view tells: as far as the object's outline passes outside, it is moved outward. A
plain side that bulges is on the outline in one view or another all over; a recess in none, and stays where it is.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.outline_gaps import SILHOUETTE_MARGIN, on_outlines
from massprops.surface.refine import vertex_normals
from massprops.views import Views

ROUNDS = 3
NEIGHBOURS = 12
"""Places on outlines whose middle says how far out a vertex should be."""
REACH = 0.08
"""Distance from which on an outline says nothing of a vertex, over the mesh's greatest extent."""


def filling_outlines(
    vertices: np.ndarray,
    faces: np.ndarray,
    free: np.ndarray,
    views: Views,
    masks: list[np.ndarray],
    pixel: float,
) -> np.ndarray:
    """The mesh (v, 3) whose unmeasured part fills its silhouettes where it is on an outline.

    Args:
        vertices: (v, 3); faces: (f, 3).
        free: (v,) bool, vertices that may move.
        views: n cameras; masks: n undistorted silhouettes (h, w), 255 object, 0 sky, anything between no evidence.
        pixel: its size at the object [world units].
    """
    from scipy.spatial import cKDTree

    out, reach = vertices.copy(), REACH * float(np.ptp(vertices, axis=0).max())
    moving = np.flatnonzero(free)
    for _ in range(ROUNDS):
        face, gap, _ = on_outlines(out, faces, views, masks)
        may_move = free[faces[face]].all(axis=1)
        face, gap = face[may_move], gap[may_move]
        if len(face) < NEIGHBOURS:
            break
        normal = vertex_normals(out, faces)
        # the two sides of a thin part are different places
        place = np.concatenate([out, 2 * reach * normal], axis=1)
        near, which = cKDTree(place[faces[face]].mean(axis=1)).query(place[moving], NEIGHBOURS)
        gap_nearby = np.where(near[:, -1] < reach, np.median(gap[which], axis=1), 0.0)
        out[moving] += np.maximum(gap_nearby - SILHOUETTE_MARGIN, 0.0)[:, None] * pixel * normal[moving]
    return out
