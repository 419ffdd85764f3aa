"""Photographs that hang together by themselves: their model is joined to the largest one.

Photographs of a side that is seen from afar in one other view only fall into a model of their own: too few of the usual
features match across so wide an angle. There fainter features are asked, and only between these images and the placed
ones. COLMAP then adds placed images to the smaller model. Such an image is in both models: it gives the rotation and
the place of the smaller one, and the distances at which both models see what is near each other in it give its size.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap
from scipy.spatial import cKDTree

from massprops.core.robust import mad_sigma
from massprops.errors import NotPossible
from massprops.sfm import pairs as pairing
from massprops.sfm.attempt import ModelInputs, Names
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.database import write_database
from massprops.sfm.features import extract_all
from massprops.sfm.left_out_images import REACH, agreeing_matches, take_out_contradicted
from massprops.sfm.loops import match_predicted
from massprops.sfm.mapping import MappingOptions, map_images, match, retriangulate
from massprops.sfm.points import SparsePoints
from massprops.views import Views

FEWEST = 3
"""Images that make a model."""

ACROSS = 400
"""Pairs of an image of the smaller model and a placed one that are compared, those that look most alike: a tenth of a second
each."""

WITHIN = 12
"""Images of the smaller model with which each of its own is compared."""

LEAST = 8
"""Distances by which the size of the smaller model is told."""

LARGEST_SIZE_SIGMA = 0.01
"""Standard deviation of the smaller model's size, relative, up to which it is joined: a camera a quarter turn away from the
common view is then off by about as much of the image's side, and features are looked for within twice that
(`massprops.sfm.loops.GATES`). 0.0016 where five photographs of a rough head were joined by 17 distances."""


@dataclass(frozen=True)
class Link:
    """Where a smaller model lies: x -> scale R x + t, with R (3, 3) and t (3,); ratios (n,) of the distances that told its
    size."""

    scale: float
    R: np.ndarray
    t: np.ndarray
    ratios: np.ndarray


def join_models(
    model: pycolmap.Reconstruction, apart: list[pycolmap.Reconstruction], given: ModelInputs
) -> pycolmap.Reconstruction:
    """The model with the images of those `apart` that can be joined to it.

    An image is added only if at least as many of its matches as place any image agree with where it is put, and no more
    contradict it.
    """
    for number, other in enumerate(apart):
        placed = {model.image(i).name for i in model.reg_image_ids()}
        fresh = sorted({other.image(i).name for i in other.reg_image_ids()} - placed)
        if len(fresh) < FEWEST:
            continue
        work = given.work / f"joined{number}"
        try:
            grown = _joined(model, fresh, replace(given, work=work))
        except NotPossible:
            continue
        if grown.num_reg_images() > model.num_reg_images():
            model = grown
    return model


def _joined(model: pycolmap.Reconstruction, fresh: list[str], given: ModelInputs) -> pycolmap.Reconstruction:
    smaller = _linked(model, fresh, given)
    views, ids = to_views(model)
    smaller_views, own_ids = to_views(smaller)
    connection = link((views, to_points(model, ids)), (smaller_views, to_points(smaller, own_ids)))
    if connection is None:
        return model
    known = set(model.reg_image_ids())
    grown = _with_images(model, smaller, connection, set(fresh), given.found.database)
    grown = retriangulate(grown, given.found.database, given.frames, given.work / "tracks", given.found.mapping)
    grown = match_predicted(grown, given, given.work, set(fresh))
    take_out_contradicted(grown, given.found.database, known)
    agreeing = agreeing_matches(grown, given.found.database, known)
    return grown if sum(agree for agree, _ in agreeing.values()) >= given.found.mapping.least_inliers else model


def _linked(model: pycolmap.Reconstruction, fresh: list[str], given: ModelInputs) -> pycolmap.Reconstruction:
    """The images `fresh` mapped by fainter features, with those of the model that they then hold.

    Raises:
        NotPossible: they do not hang together so.
    """
    footage, options, mapping = given.footage, given.options, given.found.mapping
    placed = sorted(model.image(i).name for i in model.reg_image_ids())
    wanted = set(placed) | set(fresh)
    part = replace(footage, frames=tuple(f for f in footage.frames if f.name in wanted))
    features, _ = extract_all(part, options.faint, mapping.masked, options.threads, given.progress, options.parts)
    given.work.mkdir(parents=True, exist_ok=True)
    database = given.work / "database.db"
    write_database(database, part, features)
    with pycolmap.Database.open(database) as db:
        for camera in model.cameras.values():
            db.update_camera(camera)
    few = replace(
        mapping, least_inliers=mapping.least_inliers // 2, constant=mapping.constant | frozenset(model.cameras)
    )
    pairs = _pairs([n for n in fresh if n in features], [n for n in placed if n in features], features, options.seed)
    given.progress(0, len(pairs), "matching")
    match(database, pairs, few)
    return _largest(database, given.frames, given.work / "models", few, set(fresh))


def _pairs(fresh: list[str], placed: list[str], features: dict[str, tuple[np.ndarray, np.ndarray]], seed: int) -> Names:
    signatures = pairing.signatures([features[n][1] for n in fresh + placed], seed)
    pairs = [(fresh[i], fresh[j]) for i, j in pairing.similar(signatures[: len(fresh)], WITHIN, 1)]
    alike = signatures[: len(fresh)] @ signatures[len(fresh) :].T
    first = np.argsort(-alike, axis=None, kind="stable")[:ACROSS]
    return pairs + [
        (fresh[i], placed[j]) for i, j in zip(*(k.tolist() for k in np.unravel_index(first, alike.shape)), strict=True)
    ]


def _largest(
    database: Path, frames: Path, out: Path, mapping: MappingOptions, fresh: set[str]
) -> pycolmap.Reconstruction:
    models = map_images(database, frames, out, mapping, len(fresh))
    return max(models, key=lambda m: sum(m.image(i).name in fresh for i in m.reg_image_ids()))


def link(larger: tuple[Views, SparsePoints], smaller: tuple[Views, SparsePoints]) -> Link | None:
    """Where the smaller of two models lies in the larger, by the images that are in both; None if these do not tell.

    Args:
        larger, smaller: the placed images of each and what they saw.
    """
    (views, points), (smaller_views, own_points) = larger, smaller
    told: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for name in sorted(set(views.names) & set(smaller_views.names)):
        told[name] = _distances(
            views, points, views.names.index(name), (smaller_views, own_points, smaller_views.names.index(name))
        )
    if not told or sum(len(z) for z, _ in told.values()) < LEAST:
        return None
    ratios = np.concatenate([np.log(theirs / ours) for theirs, ours in told.values()])
    if mad_sigma(ratios - np.median(ratios)) > LARGEST_SIZE_SIGMA * np.sqrt(len(ratios)):
        return None
    name = max(sorted(told), key=lambda n: len(told[n][0]))
    i, j = views.names.index(name), smaller_views.names.index(name)
    scale = float(np.exp(np.median(ratios)))
    return Link(
        scale,
        views.R[i].T @ smaller_views.R[j],
        views.R[i].T @ (scale * smaller_views.t[j] - views.t[i]),
        np.exp(ratios),
    )


def _distances(
    views: Views, points: SparsePoints, i: int, other: tuple[Views, SparsePoints, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Depths (n,) of points of one image in two models, first in that of `views`, wherever a point of the other is near."""
    other_views, own_points, j = other
    (at, depth), (own_at, own_depth) = _seen(views, points, i), _seen(other_views, own_points, j)
    if not len(at) or not len(own_at):
        return np.zeros(0), np.zeros(0)
    away, nearest = cKDTree(at).query(own_at)
    near = away < REACH * float(views.size[i].max())
    return depth[nearest[near]], own_depth[near]


def _seen(views: Views, points: SparsePoints, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) [px] and depths (n,) of the points that view i sees."""
    mine = points.obs_view == i
    depth = points.xyz[points.obs_point[mine]] @ views.R[i][2] + views.t[i][2]
    return points.obs_uv[mine][depth > 0], depth[depth > 0]


def _with_images(
    model: pycolmap.Reconstruction, smaller: pycolmap.Reconstruction, found: Link, fresh: set[str], database: Path
) -> pycolmap.Reconstruction:
    """The model with the images `fresh` of the smaller one placed by the link; points are to be found anew."""
    grown = pycolmap.Reconstruction(model)
    with pycolmap.Database.open(database) as db:
        numbers = {image.name: image.image_id for image in db.read_all_images()}
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
    for image_id in sorted(smaller.reg_image_ids()):
        old = smaller.image(image_id)
        if old.name not in fresh:
            continue
        if not grown.exists_camera(old.camera_id):
            grown.add_camera_with_trivial_rig(cameras[old.camera_id])
        pose = np.asarray(old.cam_from_world().matrix())
        R = pose[:, :3] @ found.R.T
        placed = pycolmap.Rigid3d(np.column_stack([R, found.scale * pose[:, 3] - R @ found.t]))
        image = pycolmap.Image(name=old.name, camera_id=old.camera_id, image_id=numbers[old.name])
        grown.add_image_with_trivial_frame(image, placed)
    return grown
