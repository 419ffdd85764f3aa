"""A model and its reverse: of a body that is far away for its size, near and far can be taken for each other.

Without perspective, points mirrored in depth that turn the other way round give the same images (Necker's cube; Koenderink and
van Doorn 1991, "Affine structure from motion"). With a little perspective both are still minima of the adjustment, and the
mapper may end in either. Adjusted, the right one fits better.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.points import residuals
from massprops.sfm.refine import Effort, adjust

MIRROR = np.diag([1.0, 1.0, -1.0])
SCALE_PX = 0.5
"""Residual from which on a further one costs little: a wrong match fits neither."""


def depth_reversal_resolved(model: pycolmap.Reconstruction, mapping: MappingOptions) -> pycolmap.Reconstruction:
    """The model or its reverse, whichever fits its images better; adjusted, with the focal length free where it was not given. Two cameras of
    one rig tell near from far."""
    candidates = [pycolmap.Reconstruction(model)]
    if all(rig.num_sensors() == 1 for rig in model.rigs.values()):
        candidates.append(reversed_in_depth(model))
    for m in candidates:
        adjust(m, not mapping.fixed_intrinsics, False, SCALE_PX, mapping.threads, Effort(60), mapping.constant)
    costs = [_cost(m) for m in candidates]
    return candidates[int(np.argmin(costs))]


def reversed_in_depth(model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """The model mirrored along the line of sight of its first image, about the middle of its points, turning the other way."""
    out = pycolmap.Reconstruction(model)
    ids = sorted(out.reg_image_ids())
    points = list(out.points3D.values())
    if not ids or not points:
        raise NotPossible("a model without images or points")
    middle = np.median([p.xyz for p in points], axis=0)
    R0 = np.asarray(out.image(ids[0]).cam_from_world().matrix())[:, :3]
    S = R0.T @ MIRROR @ R0
    for image_id in ids:
        frame = out.frame(out.image(image_id).frame_id)
        pose = np.asarray(frame.rig_from_world.matrix())
        R = MIRROR @ pose[:, :3] @ S
        t = pose[:, :3] @ middle + pose[:, 3] - R @ middle
        frame.rig_from_world = pycolmap.Rigid3d(np.column_stack([R, t]))
    for point in points:
        point.xyz = middle + S @ (point.xyz - middle)
    return out


def _cost(model: pycolmap.Reconstruction) -> float:
    """Robust mean of the squared residuals; infinite where points are behind their images."""
    views, ids = to_views(model)
    points = to_points(model, ids)
    with np.errstate(all="ignore"):
        squared = np.sum(residuals(views, points) ** 2, axis=1)
    squared[~np.isfinite(squared)] = np.inf
    return float(np.mean(np.log1p(np.minimum(squared, 1e12) / SCALE_PX**2)))
