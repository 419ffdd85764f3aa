"""How far the outlines of a mesh lie from those of the object in the images: what its cameras are wrong by.

Stereo asks no more than that neighbouring images agree. Cameras that drift from one end of a film to the other agree
with their neighbours all the same, and the surface that they measure lies inside or outside the outlines in images far
from those that measured it: nothing in the fit of the cameras shows that, and the outlines do.

On a table the cameras are held by the room. There the outlines tell of plain sides, which all views measure too deep alike.

A face that is on the mesh's outline in a view looks across the view, so the gap there is how far it is off along its normal.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from massprops.core.robust import nanmedian
from massprops.geometry.pixels import box_about
from massprops.surface.refine import face_normals
from massprops.surface.silhouette import lit_overlap, overlap
from massprops.views import Views

FARTHEST = 16.0
"""Distance [px] from which on an outline is another's, or that of a part that is missing or unlit."""
SILHOUETTE_MARGIN, SHARP = 1.0, 1.0
"""Where cameras are right the object's outline lies up to this far outside the mesh's, since silhouettes take in the pixels that
the object fills in part, and scatters by as much [px]. An asteroid in 320x240 and one blurred by motion had 1.0 and 1.4 in the
middle and 0.7 and 0.8 of scatter; five films of asteroids and spacecraft whose cameras were wrong 1.4 to 3.2, and 1.9 to 3.5."""
OUTLINE_SIGMA = 0.7
"""1-sigma of that margin, which all silhouettes of a film have in common [px]. Not measured: what outlines weigh beside brightness."""
MUTUAL = 2.0
"""By how much nearer to an outline another place of the other one may be [px], for both to be outlines of one place."""
BULK, BULK_MEAN = 0.8, 0.5586
"""Share of deviations that are averaged, the smallest, and what their mean is for a normal distribution of 1-sigma 1."""
LARGEST_MARGIN = 1.0
"""Part of an offset that may be a wider margin, by other images or other light [px]."""
NEIGHBOURS, FEWEST = 60, 15
"""Places on outlines that say where a face should be, and how many of them it takes."""


@dataclass(frozen=True)
class Gaps:
    """What the outlines say of a mesh.

    Attributes:
        offset: (f,) how far outside the mesh the object is at each face, beyond the silhouettes' margin, as far as cameras are wrong [px].
        drift: 1-sigma by which the object's outline scatters about the mesh's, beyond what it does where cameras are right [px].
        middle: (f,) how far outside the mesh the object's outline is in the middle [px]; where no outline speaks, the mean of
            all that do: what all views measure too deep alike is as deep there.
        distance: (f,) from the nearest place that an outline shows where the mesh has it [world units], on the same side of a
            thin part; infinite where there is none.
        overlap: (n,) of each view, as `on_outlines` gives it.
    """

    offset: np.ndarray
    drift: float
    middle: np.ndarray
    distance: np.ndarray
    overlap: np.ndarray = field(default_factory=lambda: np.zeros(0))


def outline_gaps(
    vertices: np.ndarray,
    faces: np.ndarray,
    views: Views,
    masks: list[np.ndarray],
    reach: float,
    measured: np.ndarray | None = None,
) -> Gaps:
    """How far the mesh's outlines lie from the object's.

    Args:
        vertices: (v, 3) and faces: (f, 3) of the mesh.
        views: n cameras; masks: n undistorted silhouettes (h, w), 255 object, 0 sky, anything between no evidence.
        reach: distance within which outlines speak for a face [world units].
        measured: as for `on_outlines`.
    """
    from scipy.spatial import cKDTree

    face, gap, alike = on_outlines(vertices, faces, views, masks, measured)
    if len(face) < NEIGHBOURS:
        return Gaps(np.zeros(len(faces)), 0.0, np.zeros(len(faces)), np.full(len(faces), np.inf), alike)
    # the two sides of a plate are different places
    place = np.column_stack([vertices[faces].mean(axis=1), 2 * reach * face_normals(vertices, faces)])
    near, which = cKDTree(place[face]).query(place, NEIGHBOURS, distance_upper_bound=reach)
    told = np.isfinite(near)
    gaps_nearby = np.where(told, gap[np.minimum(which, len(gap) - 1)], np.nan)
    enough = told.sum(axis=1) >= FEWEST
    middle = np.full(len(faces), SILHOUETTE_MARGIN)
    middle[enough] = nanmedian(gaps_nearby[enough], axis=1)
    whole = float(np.median(gap))
    drift = float(np.sqrt(max(0.0, _spread(gap - whole) ** 2 - SHARP**2)))
    # where outlines agree in all images and with most of the mesh, cameras are right, and only silhouettes are wide in places
    wrong = min(1.0, float(np.hypot(drift, _beyond_margin(np.array(whole)))) / SHARP)
    agree = np.unique(face[_beyond_margin(gap) == 0])
    away = cKDTree(place[agree]).query(place)[0] if len(agree) else np.full(len(faces), np.inf)
    elsewhere = float(middle[enough].mean()) if enough.any() else 0.0
    return Gaps(wrong * _beyond_margin(middle), drift, np.where(enough, middle, elsewhere), away, alike)


def _beyond_margin(gap: np.ndarray) -> np.ndarray:
    """What of gaps is beyond the silhouettes' margin [px]; exact silhouettes have none."""
    return np.where(
        gap > SILHOUETTE_MARGIN + LARGEST_MARGIN, gap - SILHOUETTE_MARGIN, np.where(gap < -LARGEST_MARGIN, gap, 0.0)
    )


def _spread(apart: np.ndarray) -> float:
    """1-sigma of deviations (k,), from those that are not among the largest, of which a missing part makes some. A median would
    come in steps of pixels."""
    size = np.sort(np.abs(apart))
    return float(size[: max(1, int(BULK * len(size)))].mean()) / BULK_MEAN


def on_outlines(
    vertices: np.ndarray,
    faces: np.ndarray,
    views: Views,
    masks: list[np.ndarray],
    measured: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces (k,) on the mesh's outline in some view, how far outside it the object's outline is there (k,) [px], and how much of
    each view's silhouette the mesh covers (n,), as `silhouette.agreement` gives it.

    Args:
        measured: (f,) bool, faces that stereo measured, of a body in sunlight before the sky: the silhouettes are compared by
            `silhouette.lit_overlap`. None: of any other.
    """
    from massprops.geometry.rasterise import rasterise

    rim_faces, gaps, alike = [np.zeros(0, int)], [np.zeros(0)], np.zeros(len(masks))
    for i, mask in enumerate(masks):
        drawn = rasterise(vertices, faces, views.K[i], views.R[i], views.t[i], mask.shape[::-1])[1]
        body = drawn >= 0
        rim, gap = np.zeros(mask.shape, bool), np.zeros(0)
        shown = (body | (mask == 255)).astype(np.uint8)
        if shown.any():
            about = box_about(shown, 2)
            rim[about], gap = _gaps(body[about], mask[about])
        alike[i] = overlap(body, mask) if measured is None else lit_overlap(body, mask, body & measured[drawn])
        rim_faces.append(drawn[rim])
        gaps.append(gap)
    return np.concatenate(rim_faces), np.concatenate(gaps), alike


def _gaps(drawn: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (h, w) bool of a drawn body's outline that have the object's within reach, and how far outside it is (k,) [px].

    An object's outline is where it borders on sky: the unlit side, of which a silhouette says nothing, is left out.
    """
    import cv2

    side = np.ones((3, 3), np.uint8)
    edge = (mask == 255) & (cv2.dilate((mask == 0).astype(np.uint8), side) > 0)
    rim = drawn & (cv2.erode(drawn.astype(np.uint8), side) == 0)
    if not edge.any() or not rim.any():
        return np.zeros(mask.shape, bool), np.zeros(0)
    away, nearest = cv2.distanceTransformWithLabels(
        (~edge).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    unknown = cv2.dilate(((mask > 0) & (mask < 255)).astype(np.uint8), side) > 0
    by_label = np.zeros(nearest.max() + 1, bool)
    by_label[nearest[edge & unknown]] = True
    # a gap between slats that the silhouette does not show has no counterpart: the outline found for it has one of its own
    back = cv2.distanceTransform((~rim).astype(np.uint8), cv2.DIST_L2, 5)
    least = np.zeros(nearest.max() + 1)
    least[nearest[edge]] = back[edge]
    rim &= (away < FARTHEST) & (least[nearest] > away - MUTUAL) & ~by_label[nearest] & ((mask == 0) | (mask == 255))
    return rim, np.where(mask == 255, away, -away)[rim].astype(float)
