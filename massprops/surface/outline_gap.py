"""How far a surface's outlines are from the silhouettes: two measurements of one body that know nothing of each other.

Stereo measures the surface, colours give the silhouettes. Where a plain side is measured too deep, as all views err alike
there, its points scatter little; but its rim then lies within the silhouettes of the views that see it edge-on.
"""

from __future__ import annotations

import numpy as np

from massprops.geometry.rasterise import silhouette
from massprops.mass.integrals import greatest_length
from massprops.surface.refine import face_normals
from massprops.views import Views

LONGEST = 0.02
"""Gap over the length of the body from which on a silhouette shows something else there, as a shadow or a part that is
missing."""
LIKE = 0.5
"""Least cosine between the normals of a face and of a rim that speaks for it."""
NEAR, FEWEST = 24, 4
"""Rims nearest to a face that are asked, and how many of them must look its way."""
MOST_RIMS = 20_000
"""Rims that are kept, evenly of all: their gaps are alike over many pixels."""
EDGE_ON = 0.3
"""Largest cosine between a face's normal and the line of sight for it to be a rim."""


def outline_gaps(vertices: np.ndarray, faces: np.ndarray, views: Views, masks: list[np.ndarray]) -> np.ndarray:
    """(f,) how much farther out than each face the silhouettes end, in the median of the rims near it that look the same
    way [units of the vertices]; the median of all rims where there are too few, 0 where there are none.

    Args:
        vertices: (v, 3); faces: (f, 3), wound outward.
        views: n cameras; masks: n arrays (h, w) uint8: 255 object, 0 surroundings, anything between is no evidence.
    """
    from scipy.spatial import cKDTree

    middle, normal = vertices[faces].mean(axis=1), face_normals(vertices, faces)
    rims = [_of_view((vertices, faces), middle, normal, views, i, mask) for i, mask in enumerate(masks)]
    place, direction, gap = (np.concatenate([rim[k] for rim in rims]) for k in range(3))
    close = np.abs(gap) < LONGEST * greatest_length(vertices)[0]
    place, direction, gap = (of[close][:: 1 + len(gap) // MOST_RIMS] for of in (place, direction, gap))
    if len(gap) < FEWEST:
        return np.zeros(len(faces))
    near = cKDTree(place).query(middle, k=min(NEAR, len(gap)))[1]
    own = np.where(np.einsum("fki,fi->fk", direction[near], normal) > LIKE, gap[near], np.nan)
    known = np.isfinite(own).sum(axis=1) >= FEWEST
    out = np.full(len(faces), float(np.median(gap)))
    out[known] = np.nanmedian(own[known], axis=1)
    return out


def _of_view(
    mesh: tuple[np.ndarray, np.ndarray],
    middle: np.ndarray,
    normal: np.ndarray,
    views: Views,
    view: int,
    mask: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rims of the mesh as one view sees them: places (m, 3), outward directions (m, 3) and gaps (m,)."""
    import cv2

    nothing = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    if not (mask == 255).any() or not (mask == 0).any():
        return nothing
    K, R, t = views.K[view], views.R[view], views.t[view]
    drawn = silhouette(*mesh, K, R, t, mask.shape[::-1]).astype(np.uint8)
    inside = cv2.distanceTransform(drawn, cv2.DIST_L2, 5)
    mask_away = _signed_distance(mask)
    away = middle - views.centres[view]
    own = np.flatnonzero(np.abs(np.einsum("fi,fi->f", normal, away)) < EDGE_ON * np.linalg.norm(away, axis=1))
    camera = middle[own] @ R.T + t
    own, camera = own[camera[:, 2] > 0], camera[camera[:, 2] > 0]
    uv = np.rint(camera[:, :2] / camera[:, 2:] @ K[:2, :2].T + K[:2, 2]).astype(int)
    seen = ((uv >= 0) & (uv < np.array(mask.shape[::-1]))).all(axis=1)
    own, uv, depth = own[seen], uv[seen], camera[seen, 2]
    depth_in, gap = inside[uv[:, 1], uv[:, 0]], mask_away[uv[:, 1], uv[:, 0]]
    # the outermost pixels of the drawn outline; a face may end just beyond their centres
    rim = (depth_in <= 1.5) & np.isfinite(gap)
    gap = (gap - (depth_in - 0.5))[rim] * depth[rim] / K[0, 0]
    return middle[own[rim]], normal[own[rim]], gap


def _signed_distance(mask: np.ndarray) -> np.ndarray:
    """(h, w) distance to the silhouette's outline [px], positive within; NaN where that outline borders on no evidence."""
    import cv2

    own = (mask == 255).astype(np.uint8)
    within, without = (cv2.distanceTransform(m, cv2.DIST_L2, 5) for m in (own, 1 - own))
    # the outline runs between the pixels
    out = np.where(own > 0, within - 0.5, 0.5 - without).astype(float)
    # an outline that borders on no evidence says nothing
    vague = ((mask > 0) & (mask < 255)).astype(np.uint8)
    out[cv2.distanceTransform(1 - vague, cv2.DIST_L2, 5) <= np.abs(out) + 1.5] = np.nan
    return out
