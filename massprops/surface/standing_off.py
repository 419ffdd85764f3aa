"""Pieces of measured surface off the body that few images show beside it: bits of what it lies on.

Where silhouettes of neighbouring images take in some of a mat in shade, stereo measures it, and a fill reaches out to it: a horn. A
part of the body, such as a leg of which only the tip was measured, stands beside the rest in images from all round.
"""

from __future__ import annotations

import numpy as np

from massprops.geometry.projection import pixels_of
from massprops.geometry.rasterise import silhouette
from massprops.surface.refine import membrane, pieces, vertex_normals
from massprops.views import Views

MOSTLY = 0.5
"""Share of the images which must show a piece beside the rest for it to be the body's, and of its places that must lie there. On a skull that
lay in foam (photographs) pieces of the mat did in .28 to .41."""
BESIDE_PX = 2
"""Places as near to the outline of the rest are not beside it: outlines are off by as much."""


def standing_off(vertices: np.ndarray, faces: np.ndarray, fixed: np.ndarray, views: Views) -> np.ndarray:
    """(v,) bool: vertices of pieces that stand farther out from a film over the largest piece than they are wide, and that fewer than half of
    the images show beside it.

    Args:
        vertices: (v, 3); faces: (f, 3), closed; fixed: (v,) bool, measured.
        views: n cameras, undistorted.
    """
    out, label, held = np.zeros(len(vertices), bool), pieces(faces, fixed), np.flatnonzero(fixed)
    held = held[np.argsort(label[held], kind="stable")]
    parts = np.split(held, np.flatnonzero(np.diff(label[held])) + 1)
    largest = max(parts, key=len)
    if len(parts) < 2:
        return out
    stretched = membrane(vertices, faces, np.isin(np.arange(len(vertices)), largest))
    outward = vertex_normals(stretched, faces)
    off = [p for p in parts if p is not largest and _far(vertices[p], stretched[p], outward[p])]
    if not off:
        return out
    beside = np.array([_beside([vertices[p] for p in off], (stretched, faces), views, i) for i in range(len(views))])
    for part, shown in zip(off, beside.T, strict=True):
        known = shown[np.isfinite(shown)]
        if len(known) and known.mean() < MOSTLY:
            out[part] = True
    return out


def _far(places: np.ndarray, film: np.ndarray, outward: np.ndarray) -> bool:
    """Whether places (k, 3) lie farther outside of where the film (k, 3) has them, whose normals are `outward` (k, 3), than they reach aside."""
    way = (places - film).mean(axis=0)
    away = float(np.linalg.norm(way))
    # what lies inward is the floor of a hollow, which the rest hides
    if np.mean(outward @ way) <= 0.0:
        return False
    aside = places - places.mean(axis=0)
    aside = aside - np.outer(aside @ way, way) / away**2
    return bool(away > 2.0 * np.linalg.norm(aside, axis=1).max())


def _beside(parts: list[np.ndarray], rest: tuple[np.ndarray, np.ndarray], views: Views, i: int) -> np.ndarray:
    """(p,) 1 where most places (k, 3) of a part lie beside the rest in image i, 0 where they do not, nan where they are not in the frame.

    Args:
        rest: its vertices (v, 3) and faces (f, 3).
    """
    import cv2

    camera, size = (views.K[i], views.R[i], views.t[i]), (int(views.size[i, 0]), int(views.size[i, 1]))
    covered = silhouette(*rest, *camera, size).astype(np.uint8)
    covered = cv2.dilate(covered, np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8))
    lies_beside = np.full(len(parts), np.nan)
    for k, places in enumerate(parts):
        inside, rows, columns = pixels_of(places, *camera, covered.shape)
        if len(inside) > MOSTLY * len(places):
            lies_beside[k] = float(np.mean(covered[rows, columns] == 0) > MOSTLY)
    return lies_beside
