"""Where the surface about points of one model shows in the images of another, seen from 60 degrees away.

SIFT does not match a cratered surface across such an angle. A patch does that is drawn as it lies: a small square of the
plane through a point and its neighbours, compared with the other image at every place near the one where it is thought to
be (viewpoint invariant patches: Wu and others 2008). Most of these places are right by a third only, but wrong ones agree
on nothing (`massprops.sfm.consensus`).
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from massprops.geometry.interpolation import peak
from massprops.geometry.vectors import unit
from massprops.sfm.consensus import Candidates
from massprops.sfm.points import SparsePoints, project_camera
from massprops.views import Views

Grey = Callable[[int], np.ndarray]
"""Image (h, w) float32 of a view, 0 where it shows nothing of the body."""

HALF = 6
"""Half the side of a patch [px of the image that it is taken from]: of a cratered body seen from 60 degrees apart, patches
of 11 px had a correlation of 0.33 to 0.46 in the median, of 25 px 0.22, and 0 in the wrong place."""

NEIGHBOURS = 10
"""Points that give a patch its plane."""

FACING = 0.3
"""Cosine between the plane's normal and a line of sight below which a patch shows nothing."""

TARGETS = 3
"""Images of the other model with which a patch is compared."""

CONTRAST = 3.0
"""Standard deviation of a patch's grey levels below which it has no texture."""

LEAST = 0.5
"""Correlation below which a place is no candidate: a third of the right places are above 0.6, and of wrong ones few."""


def patch_candidates(views: Views, points: SparsePoints, own: np.ndarray, reach: int, grey: Grey) -> Candidates:
    """Places, in the other views, of the surface about points that the views `own` saw.

    Args:
        views, points: both models as they are thought to lie.
        own: (n,) bool, views of the model that the patches are taken from.
        reach: how far from where it is thought to be a patch is looked for [px].
    """
    normal, centres, others = _normals(points), views.centres, np.flatnonzero(~own)
    mine = own[points.obs_view]
    images: dict[int, np.ndarray] = {}
    point, view, place = [], [], []
    for p in np.unique(points.obs_point[mine]).tolist():
        seen = points.obs_view[(points.obs_point == p) & mine]
        sight = unit(centres - points.xyz[p])
        n = normal[p] if sight[seen].mean(0) @ normal[p] > 0 else -normal[p]
        facing = sight @ n
        targets, sources = others[facing[others] > FACING], seen[facing[seen] > FACING]
        if not len(targets) or not len(sources):
            continue
        alike = sight[sources] @ sight[targets].T
        for k in np.argsort(-alike.max(0), kind="stable")[:TARGETS].tolist():
            i, j = int(sources[alike[:, k].argmax()]), int(targets[k])
            for v in (i, j):
                if v not in images:
                    images[v] = grey(v)
            position = _found(views, (i, j), points.xyz[p], n, reach, (images[i], images[j]))
            if position is not None:
                point.append(p)
                view.append(j)
                place.append(position)
    return Candidates(np.array(point, int), np.array(view, int), np.array(place, float).reshape(-1, 2))


def _normals(points: SparsePoints) -> np.ndarray:
    """(m, 3) unit normals of the planes through each point and its neighbours, of either sense; nan without enough."""
    from scipy.spatial import cKDTree

    if len(points.xyz) <= NEIGHBOURS:
        return np.full((len(points.xyz), 3), np.nan)
    _, near = cKDTree(points.xyz).query(points.xyz, k=NEIGHBOURS + 1)
    x = points.xyz[near] - points.xyz[near].mean(1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", x, x))[1][:, :, 0]


def _found(
    views: Views, pair: tuple[int, int], x: np.ndarray, n: np.ndarray, reach: int, images: tuple[np.ndarray, np.ndarray]
) -> np.ndarray | None:
    """Place (2,) of a patch of normal n about x in the second view [px], or None where it is not lit, leaves the image or is like
    nothing there."""
    i, j = pair
    size = float(views.R[i][2] @ x + views.t[i][2]) / views.K[i][0, 0]
    a = unit(np.cross(views.R[i][1], n))
    axes = size * np.stack([a, np.cross(n, a)])
    patch, there = _drawn(views, i, x, axes, HALF, images[0]), _drawn(views, j, x, axes, HALF + reach, images[1])
    if patch is None or there is None or patch.min() <= 0 or patch.std() < CONTRAST:
        return None
    likeness = cv2.matchTemplate(there, patch, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
    shift = np.array([column, row]) - reach
    # a patch of black sky is like all others, and a peak at the border is none
    lit = there[row : row + 2 * HALF + 1, column : column + 2 * HALF + 1]
    if not likeness[row, column] > LEAST or lit.std() < CONTRAST or np.abs(shift).max() == reach:
        return None
    finer = [peak(*likeness[row, column - 1 : column + 2]), peak(*likeness[row - 1 : row + 2, column])]
    at = x + (shift + finer) @ axes
    c = at @ views.R[j].T + views.t[j]
    return project_camera(views.K[j][None], views.distortion[j][None], c[None])[0]


def _drawn(views: Views, i: int, x: np.ndarray, axes: np.ndarray, half: int, image: np.ndarray) -> np.ndarray | None:
    """(2 half + 1,) * 2 grey levels of the plane at x, in steps of the axes (2, 3); None where it reaches behind the camera."""
    g = np.arange(-half, half + 1)
    at = x + g[None, :, None] * axes[0] + g[:, None, None] * axes[1]
    c = (at @ views.R[i].T + views.t[i]).reshape(-1, 3)
    if (c[:, 2] <= 0).any():
        return None
    uv = project_camera(views.K[i][None], views.distortion[i][None], c).astype(np.float32)
    u, v = uv.T.reshape(2, len(g), len(g))
    return cv2.remap(image, u.copy(), v.copy(), cv2.INTER_LINEAR)
