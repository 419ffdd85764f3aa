"""Features at the outline of a body before the sky: they are partly of the sky, which does not turn with the body.

Where a feature lies is found in a window about it. At an outline half of that is sky, however the body is turned, so that the feature keeps
to the outline rather than to the body, in image after image. Of three path-traced CubeSats the first ratio of the inertia, as a motion
through all features shows it, was off by .043, -.075 and -.007; without those at outlines by -.004, -.013 and +.013.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap

import numpy as np
import pycolmap

from massprops.sfm.convert import to_points, to_views
from massprops.sfm.features import read_mask
from massprops.sfm.footage import FootageRecord

REACH = 6.0
"""Half the width of the window of the smallest features [px]: four of their scales. With 4.5 px k1 of those three is off by -.006, -.009 and
+.002, with 8 px, which leaves few features on the second, by -.010, -.077 and +.016."""


def drop_outline_points(model: pycolmap.Reconstruction, footage: FootageRecord) -> None:
    """Takes points out of a model, in place, that most of their images show at an outline."""
    views, ids = to_views(model)
    points = to_points(model, ids)
    frames = {f.name: f for f in footage.frames}
    near = np.zeros(len(points.obs_view), bool)
    for i, name in enumerate(views.names):
        mask = read_mask(footage, name, footage.size(frames[name]))
        of_view = np.flatnonzero(points.obs_view == i)
        if mask is not None and len(of_view):
            near[of_view] = _near_outline(mask, points.obs_uv[of_view])
    seen = np.bincount(points.obs_point, minlength=len(points.id))
    of_outlines = np.bincount(points.obs_point, near, len(points.id)) > 0.5 * seen
    for point_id in points.id[of_outlines].tolist():
        model.delete_point3D(point_id)


def _near_outline(mask: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(k,) bool: places uv (k, 2) within `REACH` of what a mask (h, w) does not show as the body."""
    import cv2

    deep = cv2.distanceTransform((mask > 127).astype(np.uint8), cv2.DIST_L2, 5)
    h, w = mask.shape
    at = np.clip(np.rint(uv), 0, [w - 1, h - 1]).astype(int)
    return np.asarray(deep[at[:, 1], at[:, 0]] < REACH)
