"""The last adjustment once more, with tracks of the surface itself.

Features hold a view to its neighbours; what holds one side of a thin body to the other is a long chain of them, and few
of them lie on a plain one: its cameras then err alike, and its surface lies too deep or too near by more than stereo errs. Pieces
of a coarse dense surface are followed through every view that sees them under a useful angle (`patches`): tracks many
times as long, all over the body, and with the turning view's warp taken out (as the patches of Lhuillier and Quan 2005
and of Furukawa and Ponce 2009, "Accurate camera calibration from multi-view stereo and bundle adjustment").
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pycolmap

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.sfm.convert import HALF, to_points, to_views
from massprops.sfm.points import project_camera
from massprops.sfm.precision import Precision
from massprops.sfm.refine import LAST, Effort, RefineOptions, adjust, honest, model_precision, robust_loss
from massprops.views import Views, entries

if TYPE_CHECKING:
    from massprops.dense.fusion import DensePoints
    from massprops.sfm.patches import Pictures

Image = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""`image(i)`: colour (h, w, 3) uint8 BGR and mask (h, w) uint8 of view i, both undistorted."""

MAPS, PIXELS = 40, 5_000
"""Depth maps of the coarse surface, and pixels of the object in each."""
ROOM_PIXELS = 12_000
"""Pixels in each where the object is not known yet, and what is about it is seen with it. With 6000 and 20 000 the cameras of a
plain jug on a cloth end .73 and .83 mm from the true ones in the median, 1.11 without any."""
PIECES = 4_000
VIEWS = 16
"""Most views in which a piece is looked for, drawn from all that see it."""
WIDEST = 60.0
"""Angle between two views of a piece [deg]."""
FACING = 0.3
"""Cosine of the angle between a surface's normal and the sight from which on it is followed."""
CORRELATION = 0.8
"""Of a patch with its home image, from which on it was found."""


@dataclass(frozen=True)
class Pieces:
    """m pieces of surface: xyz, normal (m, 3). Observations (k,): `point`, `view`, and their place uv (k, 2) in the undistorted
    view [px]; the view that faces a piece most is among them."""

    xyz: np.ndarray
    normal: np.ndarray
    point: np.ndarray
    view: np.ndarray
    uv: np.ndarray


LEAST = 30
"""Pieces in a view below which it needs its features beside them."""


@dataclass(frozen=True)
class OnSurface:
    """precision of the model afterwards; pieces: the model with the pieces for points, and features where a view shows too few
    of them, or None where no surface was found."""

    precision: Precision
    pieces: pycolmap.Reconstruction | None = None


def with_surface(
    model: pycolmap.Reconstruction,
    before: Precision,
    image: Image,
    options: RefineOptions,
    free_focal: bool,
    radial_terms: int | dict[int, int],
    pixels: int,
    seed: int,
    threads: int,
    progress: Progress = silent,
) -> OnSurface:
    """Adjusts in place with tracks of the surface; the model keeps its own points only.

    Where too little surface is found, or the tracks do not make the attitudes surer, the model stays as it is.

    Args:
        before: its precision.
        image: its views, in the order of their names.
        free_focal: whether focal lengths are estimated.
        radial_terms: estimated terms of the distortion, of all cameras or by number.
        pixels: that a depth map may have, `PIXELS` or `ROOM_PIXELS`.

    """
    from massprops.dense.reconstruct import DenseOptions, dense_points

    views, ids = to_views(model)
    sparse = to_points(model, ids)
    try:
        cloud, facts = dense_points(views, image, sparse, DenseOptions(MAPS, seed, threads, pixels), progress)
    except NotPossible:
        return OnSurface(before)
    pieces = follow_pieces(views, image, cloud, facts["image_factor"], seed)
    trial = pycolmap.Reconstruction(model)
    _add(trial, views, ids, pieces)
    bent = bool(radial_terms if isinstance(radial_terms, int) else any(radial_terms.values()))
    adjust(trial, free_focal, bent, options.least_loss_px, threads, Effort(20, LAST), options.constant)
    loss = robust_loss(trial, options)
    after = honest(model_precision(trial, free_focal, radial_terms, loss, options.constant), options.on_table)
    few = np.flatnonzero(np.bincount(pieces.view, minlength=len(views)) < LEAST)
    alone = _without(trial, model, {ids[i] for i in few})
    if not np.median(after.attitude) < np.median(before.attitude):
        return OnSurface(before, alone)
    for camera_id, camera in trial.cameras.items():
        model.cameras[camera_id].params = camera.params
    for frame_id in trial.reg_frame_ids():
        model.frame(frame_id).rig_from_world = trial.frame(frame_id).rig_from_world
    for point_id in model.point3D_ids():
        model.point3D(point_id).xyz = trial.point3D(point_id).xyz
    model.update_point_3d_errors()
    return OnSurface(after, alone)


def _without(
    trial: pycolmap.Reconstruction, model: pycolmap.Reconstruction, images: set[int]
) -> pycolmap.Reconstruction:
    """A copy of a model without another's points, but for those that one of the images shows."""
    out = pycolmap.Reconstruction(trial)
    for point_id in model.point3D_ids():
        if images.isdisjoint(e.image_id for e in model.point3D(point_id).track.elements):
            out.delete_point3D(point_id)
    return out


def follow_pieces(views: Views, image: Image, cloud: DensePoints, factor: float, seed: int) -> Pieces:
    """Pieces of the cloud (`massprops.dense.fusion.DensePoints`) and where they are seen.

    Args:
        factor: by which images were reduced for the cloud: its points are a pixel of such images apart.
    """
    from massprops.dense.depthmap import thresholds
    from massprops.sfm.patches import follow

    pictures, noise = _pictures(views, image)
    every = cloud.xyz.astype(float)
    chosen = _spread(every, cloud.normal, cloud.sigma)
    xyz, normal = every[chosen], cloud.normal[chosen].astype(float)
    sight = views.centres[None] - xyz[:, None]
    sight /= np.linalg.norm(sight, axis=2, keepdims=True)
    facing = np.einsum("mni,mi->mn", sight, normal)
    seen = (facing > FACING) & _in_sight(views, pictures, every, xyz, facing, factor)
    measured = np.zeros_like(seen)
    which, place = entries(cloud.view_start.astype(np.int64), chosen)
    measured[which, cloud.view_index[place]] = True
    measured &= seen
    home = np.where(measured, facing, -1).argmax(1)
    rows = np.arange(len(home))
    wanted = seen & measured.any(1)[:, None]
    wanted &= np.einsum("mni,mi->mn", sight, sight[rows, home]) > np.cos(np.deg2rad(WIDEST))
    wanted[rows, home] = False
    lot = np.where(wanted, np.random.default_rng([seed, 17]).random(wanted.shape), 2.0)
    wanted &= lot <= np.sort(lot, axis=1)[:, min(VIEWS, len(views)) - 1 : min(VIEWS, len(views))]
    point, view = np.nonzero(wanted)
    sharp = 1.0 / thresholds(float(np.median(noise)))[0]
    followed = follow(point, home[point], view, (xyz, normal), (views.R, views.t), pictures, sharp)
    good = followed[:, 2] > CORRELATION
    point, view, uv = point[good], view[good], followed[good, :2]
    often = np.bincount(point, minlength=len(xyz)) >= 2
    keep, point_of = often[point], np.cumsum(often) - 1
    xyz, normal, home, K = xyz[often], normal[often], home[often], pictures.K
    c = np.einsum("mij,mj->mi", views.R[home], xyz) + views.t[home]
    at_home = c[:, :2] / c[:, 2:] * K[home, :2] + K[home, 2:]
    return Pieces(
        xyz, normal,
        np.concatenate([np.arange(len(xyz)), point_of[point[keep]]]),
        np.concatenate([home, view[keep]]),
        np.concatenate([at_home, uv[keep]]),
    )  # fmt: skip


def _pictures(views: Views, image: Image) -> tuple[Pictures, np.ndarray]:
    """The views' images as `massprops.sfm.patches.Pictures`, and their noise (n,) in grey levels."""
    import cv2

    from massprops.dense.noise import grey_noise
    from massprops.sfm.patches import Pictures

    n, (w, h) = len(views), views.size.max(0)
    K = np.stack([views.K[:, 0, 0], views.K[:, 1, 1], views.K[:, 0, 2], views.K[:, 1, 2]], axis=1)
    grey, mask, noise = np.zeros((n, h, w), np.uint8), np.zeros((n, h, w), np.uint8), np.zeros(n)
    for i in range(n):
        colour, m = image(i)
        grey[i, : m.shape[0], : m.shape[1]] = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        mask[i, : m.shape[0], : m.shape[1]] = m
        noise[i] = grey_noise(grey[i].astype(np.float32), mask[i])
    return Pictures(grey, mask, views.size, K), noise


def _in_sight(
    views: Views, pictures: Pictures, every: np.ndarray, xyz: np.ndarray, facing: np.ndarray, factor: float
) -> np.ndarray:
    """(m, n) bool: which of the points xyz (m, 3) a view shows on the object, with none of `every` (k, 3) before them."""
    from massprops.sfm.patches import nearest_depth

    K, (w, h) = pictures.K, views.size.max(0)
    out = np.zeros((len(xyz), len(views)), bool)
    for i in range(len(views)):
        nearest = nearest_depth(every, K[i], views.R[i], views.t[i], factor, int(h * factor) + 1, int(w * factor) + 1)
        c = xyz @ views.R[i].T + views.t[i]
        uv = c[:, :2] / c[:, 2:] * K[i, :2] + K[i, 2:]
        inside = (c[:, 2] > 0) & (uv > 0).all(1) & (uv < views.size[i] - 1).all(1)
        u, v = np.where(inside[:, None], uv, 0).T
        # points of the same surface, drawn wide, lie before this one by the slope
        slack = c[:, 2] / (factor * K[i, 0]) * (1 + 2 * np.sqrt(1 / np.clip(facing[:, i], FACING, 1) ** 2 - 1))
        hidden = c[:, 2] > nearest[(v * factor).astype(int), (u * factor).astype(int)] + slack
        out[:, i] = inside & ~hidden & (pictures.mask[i][np.rint(v).astype(int), np.rint(u).astype(int)] > 0)
    return out


def _spread(xyz: np.ndarray, normal: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Indices of about PIECES points, the surest of each cell of space and side of the body."""
    axis = np.argmax(np.abs(normal), axis=1)
    side = 2 * axis + (normal[np.arange(len(normal)), axis] > 0)
    order = np.argsort(sigma, kind="stable")
    low, extent = xyz.min(0), float(np.ptp(xyz, axis=0).max())
    size, chosen = extent / 16, order[:0]
    while len(chosen) < min(PIECES, len(xyz) // 2) and size > extent / 1000:
        size *= 0.9
        cell = np.floor((xyz - low) / size).astype(np.int64)
        code = ((cell[:, 0] * 4096 + cell[:, 1]) * 4096 + cell[:, 2]) * 6 + side
        chosen = order[np.unique(code[order], return_index=True)[1]]
    return np.sort(chosen)


def _add(model: pycolmap.Reconstruction, views: Views, ids: list[int], pieces: Pieces) -> None:
    """Adds the pieces to the model as points, with their observations in its stored, distorted images."""
    K, D = views.K[pieces.view], views.distortion[pieces.view]
    ray = np.column_stack([(pieces.uv - K[:, :2, 2]) / np.stack([K[:, 0, 0], K[:, 1, 1]], 1), np.ones(len(pieces.uv))])
    uv = project_camera(K, D, ray) + HALF
    tracks = [pycolmap.Track() for _ in pieces.xyz]
    for i, image_id in enumerate(ids):
        places = model.image(image_id).points2D
        for k in np.flatnonzero(pieces.view == i):
            tracks[pieces.point[k]].add_element(image_id, len(places))
            places.append(pycolmap.Point2D(uv[k]))
    for xyz, track in zip(pieces.xyz, tracks, strict=True):
        model.add_point3D(xyz, track)
