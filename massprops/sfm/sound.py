"""What of a reconstruction can be computed with: no camera or point at infinity, no focal length at its bound.

A model of images that hardly hold together has points whose rays are parallel, cameras that ran away along with the
focal length, points behind the images that show them, or numbers that are none. They are taken out where they arise,
so that nothing after sees them; where too little is left, the footage is named as the reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import NotPossible
from massprops.sfm.points import SparsePoints, project_camera
from massprops.views import Views

if TYPE_CHECKING:
    import pycolmap

LEAST_FOCAL, MOST_FOCAL = 0.2, 10.0
"""Bounds of an estimated focal length in units of the longer side. The upper one is that of COLMAP's mapper; its lower one is .1, and a film in
foil (Blender) ran to .13 and was placed wrongly. At .2 an image is 136 degrees wide, which no lens is that has no model of its own."""

FAR = 1e3
"""Distance from the middle of the points, in medians over the cameras, from which on a camera is at infinity; a point nearer to a
camera than this part of the median is in it, where no small turn moves it by a finite number of pixels."""

PARALLEL_DEG = 0.01
"""Angle between a point's rays below which it is at infinity: a fraction of a pixel in every usual camera."""

FLAT = 2e-3
"""Thickness over width below which points count as a plane."""

VAGUE = 0.1
"""Relative standard deviation of a focal length from which on it is not known."""

FEWEST_RAYS = 3
"""A point that two images show fits any two of them that lie on an epipolar line; three rays test it."""

FEWEST_POINTS = 6
"""Points without which an image's pose is not fixed, with one to spare (four points of a plane, Gao 2003)."""


@dataclass(frozen=True)
class Sound:
    """What is left: `views` (n,) bool, `observations` (k,) bool, and why views and points were lost.

    Attributes:
        focal: views whose focal length is no number or at its bound.
        far: further views whose pose is no pose, or at infinity.
        parallel: points at infinity.
    """

    views: np.ndarray
    observations: np.ndarray
    focal: int
    far: int
    parallel: int


def sound(views: Views, points: SparsePoints, given_focal: bool = False, given_poses: bool = False) -> Sound:
    """Which views and observations can be computed with.

    Args:
        given_focal: the focal lengths were given, and need only be positive.
        given_poses: so were the poses, which no point need hold.
    """
    rays, fewest = (2, 0) if given_poses else (FEWEST_RAYS, FEWEST_POINTS)
    with np.errstate(all="ignore"):
        focal = _focal_inside(views, given_focal)
        posed = _poses(views)
        there = np.isfinite(points.xyz).all(1)
        keep = (focal & posed)[points.obs_view] & there[points.obs_point] & np.isfinite(points.obs_uv).all(1)
        keep &= _agrees(views, points, keep)
        near, parallel = np.ones(len(views), bool), 0
        for _ in range(20):
            before = int(keep.sum())
            enough, meet = _rays(views, points, keep, rays)
            parallel += int(np.sum(enough & ~meet))
            keep &= (enough & meet)[points.obs_point]
            near &= ~_at_infinity(views, points, keep, focal & posed)
            count = np.bincount(points.obs_view[keep & near[points.obs_view]], minlength=len(views))
            held = focal & posed & near & (count >= fewest)
            keep &= held[points.obs_view]
            if keep.sum() == before:
                break
    return Sound(held, keep, int(np.sum(~focal)), int(np.sum(focal & ~(posed & near))), parallel)


def _focal_inside(views: Views, given: bool) -> np.ndarray:
    f = views.K[:, [0, 1], [0, 1]].reshape(len(views), 2)
    side = views.size.max(1, initial=1)[:, None]
    low, high = (0.0, np.inf) if given else (LEAST_FOCAL * side, MOST_FOCAL * side)
    finite = np.isfinite(views.K).all((1, 2)) & np.isfinite(views.distortion).all(1)
    return finite & ((f > low) & (f < high)).all(1)


def _poses(views: Views) -> np.ndarray:
    """(n,) bool: R is a rotation, t a finite vector."""
    off = np.abs(np.einsum("nij,nkj->nik", views.R, views.R) - np.eye(3)).max((1, 2), initial=0)
    return (off < 1e-3) & (np.linalg.det(np.nan_to_num(views.R)) > 0) & np.isfinite(views.t).all(1)


def _agrees(views: Views, points: SparsePoints, keep: np.ndarray) -> np.ndarray:
    """(k,) bool: the point lies before the camera, not in it, and falls within an image's size of where it was seen."""
    out = np.zeros(len(keep), bool)
    at = np.flatnonzero(keep)
    v = points.obs_view[at]
    c = np.einsum("kij,kj->ki", views.R[v], points.xyz[points.obs_point[at]]) + views.t[v]
    miss = np.linalg.norm(project_camera(views.K[v], views.distortion[v], c) - points.obs_uv[at], axis=1)
    depth = c[:, 2]
    before = depth > 0
    out[at] = (
        before
        & (depth > (np.median(depth[before]) if before.any() else 0.0) / FAR)
        & (miss < views.size[v].max(1, initial=1))
    )
    return out


def _rays(views: Views, points: SparsePoints, keep: np.ndarray, fewest: int) -> tuple[np.ndarray, np.ndarray]:
    """(m,) bool: points with rays from enough views, and points with two rays under an angle."""
    v, p = points.obs_view[keep], points.obs_point[keep]
    m = len(points.xyz)
    seen = np.bincount(np.unique(np.column_stack([p, v]), axis=0)[:, 0], minlength=m)
    ray = points.xyz[p] - views.centres[v]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    mean = np.stack([np.bincount(p, ray[:, a], minlength=m) for a in range(3)], axis=1)
    mean = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    # by the chord: the cosine of so small an angle is 1
    apart = np.zeros(m)
    np.maximum.at(apart, p, np.linalg.norm(ray - mean[p], axis=1))
    return seen >= fewest, apart > 0.5 * np.deg2rad(PARALLEL_DEG)


def _at_infinity(views: Views, points: SparsePoints, keep: np.ndarray, posed: np.ndarray) -> np.ndarray:
    """(n,) bool: views that are far beyond the others, seen from the middle of the points, or of all without any."""
    used = np.zeros(len(views), bool)
    used[points.obs_view[keep]] = True
    used |= posed & (not used.any())
    if not used.any():
        return used
    seen = points.xyz[np.unique(points.obs_point[keep])]
    middle = np.median(seen if len(seen) else views.centres[used], axis=0)
    away = np.linalg.norm(views.centres - middle, axis=1)
    return ~(away <= FAR * np.median(away[used]))


def require_sound(found: Sound, moving: str = "the camera moves around the object") -> None:
    """Refuses a reconstruction of which too little is left.

    Raises:
        NotPossible: fewer than three views are; the message says what of the footage is the cause.
    """
    remaining_views = int(found.views.sum())
    if remaining_views >= 3:
        return
    total = len(found.views)
    if found.focal > 0.5 * total:
        raise NotPossible(
            f"the focal length of {found.focal} of {total} images ran to its bound: the footage shows too little "
            "perspective to find it; give it with --focal, or come closer and show more sides"
        )
    if found.parallel and found.far <= 0.5 * total:
        raise NotPossible(
            f"the images show no parallax: the rays to {found.parallel} points are parallel, so no shape follows from "
            f"them; make sure that {moving}, and not only pans or zooms"
        )
    # a model that was thinned out before may have no images left to count
    which = (
        f"only {remaining_views} of {total} images hold together: the others"
        if total >= 3
        else "no three images hold together: they"
    )
    raise NotPossible(
        f"{which} share too few points that three images show; give more images with more overlap (under 15 degrees "
        "between neighbours)"
    )


def take_out(
    model: pycolmap.Reconstruction, given_focal: bool = False, given_poses: bool = False
) -> tuple[Views, SparsePoints, Sound]:
    """Takes what is not sound out of a model, in place.

    Returns:
        views and points as they were before, and what of them is left.
    """
    import pycolmap

    from massprops.sfm.convert import to_points, to_views

    views, ids = to_views(model)
    points = to_points(model, ids)
    soundness = sound(views, points, given_focal, given_poses)
    kept = np.zeros(len(points.xyz), bool)
    kept[points.obs_point[soundness.observations]] = True
    for point_id in points.id[~kept].tolist():
        model.delete_point3D(point_id)
    odd = ~soundness.observations & kept[points.obs_point] & soundness.views[points.obs_view]
    pairs = np.unique(
        np.column_stack([points.id[points.obs_point[odd]], np.array(ids, int)[points.obs_view[odd]]]), axis=0
    )
    for point_id, image_id in pairs.tolist():
        for e in list(model.point3D(point_id).track.elements) if model.exists_point3D(point_id) else []:
            if e.image_id == image_id and model.exists_point3D(point_id):
                model.delete_observation(e.image_id, e.point2D_idx)
    frames = np.array([model.image(i).frame_id for i in ids], int)
    manager = pycolmap.ObservationManager(model)
    # the second camera of a rig has the pose of the first: it may see nothing of its own
    for frame_id in sorted(set(frames[~soundness.views].tolist()) - set(frames[soundness.views].tolist())):
        manager.deregister_frame(frame_id)
    return views, points, soundness


def flatness(points: SparsePoints) -> float:
    """Least over middle extent of the points; near 0 where all lie in one plane, 1 without enough points.

    The farthest twentieth does not count.
    """
    if len(points.xyz) < 4:
        return 1.0
    x = points.xyz - np.median(points.xyz, axis=0)
    away = np.linalg.norm(x, axis=1)
    x = x[away <= np.quantile(away, 0.95)]
    s = np.linalg.svd(x - x.mean(0), compute_uv=False)
    return float(s[2] / s[1]) if s[1] > 0 else 0.0


def flat_remarks(points: SparsePoints, focal_sigma: float) -> list[str]:
    """What to say of a model whose focal length was estimated and whose points lie in one plane.

    A plane fixes a focal length by the perspective of its own views alone (Zhang 2000), weakly where they are alike.

    Args:
        focal_sigma: relative standard deviation of the focal length.

    Raises:
        NotPossible: it is not fixed.
    """
    if flatness(points) > FLAT:
        return []
    if not focal_sigma < VAGUE:
        raise NotPossible(
            "all that the images have in common lies in one plane, which leaves the focal length open; give it with "
            "--focal, or let something that stands out of the plane be in view"
        )
    return ["all that the images have in common lies in one plane: the focal length rests on its perspective alone"]
