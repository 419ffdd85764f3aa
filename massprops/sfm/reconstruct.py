"""From footage to one model: features, pairs, mapping, loops, last adjustment."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from massprops.core.parts import Parts
from massprops.errors import InputError, NotPossible
from massprops.run.job import Progress, silent
from massprops.sfm import pairs as pairing
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.database import write_database
from massprops.sfm.features import FeatureOptions, extract_all, read_mask
from massprops.sfm.footage import FootageRecord
from massprops.sfm.lens import MODELS, LensChoice
from massprops.sfm.mapping import MappingOptions, map_images, match, quiet, retriangulate
from massprops.sfm.points import SparsePoints
from massprops.sfm.precision import Precision
from massprops.sfm.refine import Refined, RefineOptions, adjust, refine, remove_outliers
from massprops.sfm.sound import flat_remarks, require_sound, take_out
from massprops.sfm.steady import largest_jump
from massprops.sfm.surface_tracks import Image, with_surface
from massprops.sfm.turned import turn_image, upright
from massprops.views import Views, undistort

ENOUGH = 0.9
"""Share of the images placed from which on no other way is tried."""


@dataclass(frozen=True)
class SfmOptions:
    """Everything structure from motion can be told.

    Attributes:
        overlap: images that each image of a video is matched with, onwards in time.
        loops: further images each image is matched with when they see the same side.
        loop_angle_deg: widest angle between the directions of such a pair.
        exhaustive_below: unordered images up to this number are matched all with all.
        parts: keeps the features of each image as soon as they are found.
    """

    mapper: str = "incremental"
    overlap: int = 8
    loops: int = 4
    loop_angle_deg: float = 25.0
    exhaustive_below: int = 60
    guided: bool = False
    features: FeatureOptions = field(default_factory=FeatureOptions)
    refine: RefineOptions = field(default_factory=RefineOptions)
    seed: int = 0
    threads: int = 2
    parts: Parts | None = None


@dataclass(frozen=True)
class SolvedCamera:
    """One camera after the reconstruction.

    Attributes:
        id: as in the footage.
        images: that were placed.
        focal_px: along u and v [px].
        focal_sigma_relative: 0 where the focal length was given.
        distortion: OpenCV k1, k2, p1, p2.
        lens: the model and what spoke for it.
        estimated: whether the distortion was.
    """

    id: int
    images: int
    focal_px: tuple[float, float]
    focal_sigma_relative: float
    distortion: tuple[float, ...]
    lens: LensChoice
    estimated: bool


@dataclass(frozen=True)
class SfmResult:
    """One reconstruction.

    Attributes:
        model: the COLMAP model.
        views: its registered images by name.
        points: its points.
        models: (images, points) of every model found, largest first.
        precision: of the last adjustment.
        cameras: the one with most images first.
        warnings: one line each.
    """

    model: pycolmap.Reconstruction
    views: Views
    points: SparsePoints
    models: tuple[tuple[int, int], ...]
    precision: Precision
    cameras: tuple[SolvedCamera, ...]
    warnings: tuple[str, ...]


def reconstruct(
    footage: FootageRecord, work: Path, options: SfmOptions | None = None, progress: Progress = silent
) -> SfmResult:
    """Structure from motion of a footage; `work` is an empty folder for the database and raw models.

    Raises:
        NotPossible: fewer than three images can be placed, or the views do not turn around the object.
        InputError: an image or a mask that cannot be used.
    """
    options = options or SfmOptions()
    quiet()
    masked = footage.mask_features and footage.has_masks
    found, models, warnings = _attempt(footage, work / "a", options, masked, progress)
    used = len(footage.frames)
    if not masked and footage.has_masks and _registered(models) < 0.8 * used:
        again, others, more = _attempt(footage, work / "b", options, True, progress)
        if _registered(others) > _registered(models):
            found, models, warnings, masked = again, others, more, True
            warnings.append("only the object's own features were used: with the background fewer images fit together")
    if _registered(models) < 3:
        raise NotPossible(
            f"only {_registered(models)} of {used} images could be placed; give more images with more overlap (under 15 "
            "degrees between neighbours), sharper or better lit"
        )
    sizes = tuple((m.num_reg_images(), m.num_points3D()) for m in models)
    database, mapping = found
    given = mapping.fixed_intrinsics or bool(mapping.constant)
    require_sound(take_out(models[0], given)[2], _moving(footage))
    model = _close_loops(models[0], database, footage, options, mapping, work, progress)
    return finish(model, footage, mapping, options, sizes, warnings, progress)


def finish(
    model: pycolmap.Reconstruction,
    footage: FootageRecord,
    mapping: MappingOptions,
    options: SfmOptions,
    sizes: tuple[tuple[int, int], ...],
    warnings: list[str],
    progress: Progress = silent,
) -> SfmResult:
    """The last adjustment of a mapped model, and what is said of it.

    Args:
        model: is changed.
        sizes: (images, points) of every model found, this one's first.
        warnings: so far.

    Raises:
        NotPossible: the model fixes no shape; the message names what of the footage is the cause.
    """
    progress(0, 1, "adjustment")
    free, masked, used = not mapping.fixed_intrinsics, mapping.masked, len(footage.frames)
    given = mapping.fixed_intrinsics or bool(mapping.constant)
    settings = replace(options.refine, constant=mapping.constant, given_focal=given, moving=_moving(footage))
    test = free and _may_distort(footage)
    refined = refine(model, settings, free, test, options.threads, masked, options.seed)
    accuracy = refined.precision
    if free and not mapping.constant:
        warnings += flat_remarks(to_points(model, to_views(model)[1]), accuracy.focal_relative)
    if masked:
        image = _pictures(footage, to_views(model)[0])
        accuracy = with_surface(
            model, accuracy, image, settings, free, refined.radial_terms, options.seed, options.threads, progress
        )
    cameras = _solved(footage, model, accuracy, refined)
    model = upright(model, footage)
    model.extract_colors_for_all_images(footage.folder / "frames", options.threads)
    views, ids = to_views(model, {f.name: f.timestamp_ns for f in footage.frames})
    points = to_points(model, ids)
    progress(1, 1, "adjustment")
    turned = spread_deg(views, points)
    if not turned >= 5:
        raise NotPossible(
            f"{_moving(footage)} by {turned:.1f} degrees only, which fixes no shape; give footage that shows more sides"
        )
    if len(views) < sizes[0][0]:
        warnings.append(
            f"{sizes[0][0] - len(views)} images were taken out again: too few points hold them to the others"
        )
    warnings += _remarks(sizes, len(views), used, turned)
    return SfmResult(model, views, points, sizes, accuracy, cameras, tuple(warnings))


def _moving(footage: FootageRecord) -> str:
    return "the body turns" if footage.motion == "tumbling" else "the camera moves around the object"


def _solved(
    footage: FootageRecord, model: pycolmap.Reconstruction, accuracy: Precision, refined: Refined
) -> tuple[SolvedCamera, ...]:
    views, ids = to_views(model)
    number = np.array([model.image(i).camera_id for i in ids], int)
    out = []
    for record in footage.cameras:
        own = np.flatnonzero(number == record.id + 1)
        if not len(own):
            continue
        lens = refined.lenses.get(record.id + 1)
        K = views.K[own[0]]
        out.append(
            SolvedCamera(
                record.id,
                len(own),
                (float(K[0, 0]), float(K[1, 1])),
                float(accuracy.focal_by_camera.get(record.id + 1, 0.0)),
                tuple(float(k) for k in views.distortion[own[0]]),
                lens or LensChoice(MODELS[0] if record.distortion is None else "OPENCV"),
                lens is not None and lens.bent,
            )
        )
    return tuple(sorted(out, key=lambda c: (-c.images, c.id)))


def _pictures(footage: FootageRecord, views: Views) -> Image:
    """The views undistorted, with their silhouettes, turned as their camera's are; one without a silhouette shows
    nothing."""
    frames = {f.name: f for f in footage.frames}

    def image(i: int) -> tuple[np.ndarray, np.ndarray]:
        frame = frames[views.names[i]]
        size = footage.size(frame)
        colour, mask = cv2.imread(str(footage.image(frame.name))), read_mask(footage, frame.name, size)
        if colour is None:
            raise InputError(f"{footage.image(frame.name)}: not a readable image; run the capture stage again")
        if mask is None:
            mask = np.zeros((size[1], size[0]), np.uint8)
        K, distortion = views.K[i], views.distortion[i]
        colour, mask = turn_image(colour, frame.turn), turn_image(mask, frame.turn)
        return undistort(colour, K, distortion), undistort(mask, K, distortion, nearest=True)

    return image


def _registered(models: list[pycolmap.Reconstruction]) -> int:
    return models[0].num_reg_images() if models else 0


def _may_distort(footage: FootageRecord) -> bool:
    return all(c.distortion is None for c in footage.cameras)


def _fixed(footage: FootageRecord) -> bool:
    return all(c.focal_px is not None and c.focal_source == "given" for c in footage.cameras)


def _attempt(
    footage: FootageRecord, work: Path, options: SfmOptions, masked: bool, progress: Progress
) -> tuple[tuple[Path, MappingOptions], list[pycolmap.Reconstruction], list[str]]:
    work.mkdir(parents=True, exist_ok=True)
    mapping = MappingOptions(
        mapper=options.mapper,
        fixed_intrinsics=_fixed(footage),
        constant=frozenset(c.id + 1 for c in footage.cameras if c.focal_source == "given" and not _fixed(footage)),
        free_distortion=not masked and _may_distort(footage),
        masked=masked,
        guided=options.guided,
        seed=options.seed,
        threads=options.threads,
    )
    features, warnings = extract_all(footage, options.features, masked, options.threads, progress, options.parts)
    counts = np.array([len(k) for k, _ in features.values()])
    if np.sum(counts >= 30) < 3:
        raise NotPossible(
            f"only {int(np.sum(counts >= 30))} of {len(footage.frames)} images show enough texture to be matched; "
            "use sharper, better lit images or a larger --max-size"
        )
    database = work / "database.db"
    write_database(database, footage, features)
    names = [f.name for f in footage.frames if f.name in features]
    descriptors = [features[n][1] for n in names]
    first = _first_pairs(footage, names, descriptors, options)
    match(database, first, mapping, progress)
    models: list[pycolmap.Reconstruction] = []
    try:
        models = _mapped(database, footage, work / "models", mapping, len(names), progress)
    except NotPossible:
        if len(first) == len(names) * (len(names) - 1) // 2:
            raise
    if _registered(models) < ENOUGH * len(names):
        signatures = pairing.signatures(descriptors, options.seed)
        more = pairing.similar(signatures, 2 * options.loops, 2)
        new = _unseen([(names[i], names[j]) for i, j in more], first)
        if new:
            match(database, new, mapping, progress)
            again = _mapped(database, footage, work / "again", mapping, len(names), progress)
            models = again if _registered(again) >= _registered(models) else models
    return (database, mapping), models, warnings


def _mapped(
    database: Path, footage: FootageRecord, out: Path, mapping: MappingOptions, total: int, progress: Progress
) -> list[pycolmap.Reconstruction]:
    """The models that place most images, each held by many points or, where that loses images, by fewer:
    the two sides of a flat body hang together by the few points seen while it is edge-on. So few may be wrong, which
    the motion shows."""
    frames = footage.folder / "frames"
    models = map_images(database, frames, out / "many", mapping, total, progress)
    if _registered(models) < ENOUGH * total:
        fewer = replace(mapping, least_inliers=mapping.least_inliers // 2)
        again = map_images(database, frames, out / "few", fewer, total, progress)
        if _registered(again) > _registered(models) and _steady(again[0], footage, mapping):
            return again
    return models


def _steady(model: pycolmap.Reconstruction, footage: FootageRecord, mapping: MappingOptions) -> bool:
    """Whether the rate of turning, once adjusted, never changes by its own size from one image to the next."""
    trial = pycolmap.Reconstruction(model)
    given = mapping.fixed_intrinsics or bool(mapping.constant)
    try:
        loss = remove_outliers(trial, RefineOptions(given_focal=given), 2.0)
    except NotPossible:
        return False
    adjust(trial, not mapping.fixed_intrinsics, False, loss, mapping.threads, 20, mapping.constant)
    views, _ = to_views(trial)
    first = footage.frames[0].name.split("/", 1)[0]
    timed = all(f.timestamp_ns >= 0 for f in footage.frames)
    place = {f.name: f.timestamp_ns if timed else f.index for f in footage.frames if f.name.startswith(f"{first}/")}
    own = sorted((place[n], i) for i, n in enumerate(views.names) if n in place)
    return largest_jump(views.R[[i for _, i in own]], np.array([k for k, _ in own])) < 1.0


def _first_pairs(
    footage: FootageRecord, names: list[str], descriptors: list[np.ndarray], options: SfmOptions
) -> list[tuple[str, str]]:
    n = len(names)
    if footage.rig:
        return _rig_pairs(footage, names, options)
    if n <= (16 if footage.ordered else options.exhaustive_below):
        index = pairing.exhaustive(n)
    elif footage.ordered:
        index = pairing.sequential(n, options.overlap)
    else:
        near = pairing.similar(pairing.signatures(descriptors, options.seed), 12, 1)
        index = sorted(set(near) | set(pairing.sequential(n, 3)))
    return [(names[i], names[j]) for i, j in index]


def _rig_pairs(footage: FootageRecord, names: list[str], options: SfmOptions) -> list[tuple[str, str]]:
    by_camera = {
        c.id: [f.name for f in footage.frames if f.camera == c.id and f.name in set(names)] for c in footage.cameras
    }
    pairs = []
    for own in by_camera.values():
        pairs += [(own[i], own[j]) for i, j in pairing.sequential(len(own), max(4, options.overlap // 2))]
    first = by_camera[footage.cameras[0].id]
    for camera in footage.cameras[1:]:
        tails = {n.split("/", 1)[1]: n for n in by_camera[camera.id]}
        for i, name in enumerate(first):
            for other in first[i : i + 3]:
                partner = tails.get(other.split("/", 1)[1])
                if partner:
                    pairs.append((name, partner))
    return pairs


def _unseen(pairs: list[tuple[str, str]], old: list[tuple[str, str]]) -> list[tuple[str, str]]:
    known = {tuple(sorted(p)) for p in old}
    return [p for p in pairs if tuple(sorted(p)) not in known]


def _close_loops(
    model: pycolmap.Reconstruction,
    database: Path,
    footage: FootageRecord,
    options: SfmOptions,
    mapping: MappingOptions,
    work: Path,
    progress: Progress,
) -> pycolmap.Reconstruction:
    """Matches pairs that the first model predicts to show the same side, and rebuilds the tracks with them."""
    views, ids = to_views(model)
    directions = view_directions(views, to_points(model, ids))
    order = {f.name: i for i, f in enumerate(footage.frames)}
    index = np.argsort([order[n] for n in views.names], kind="stable")
    names = [views.names[i] for i in index]
    chosen = pairing.spread_facing(directions[index], options.loops, options.overlap + 1, options.loop_angle_deg)
    with pycolmap.Database.open(database) as db:
        pair_ids, _ = db.read_two_view_geometry_num_inliers()
    number = {model.image(i).name: i for i in ids}
    known = set(pair_ids)
    new = [
        (names[i], names[j])
        for i, j in chosen
        if pycolmap.image_pair_to_pair_id(number[names[i]], number[names[j]]) not in known
    ]
    if new:
        match(database, new, mapping, progress)
    return retriangulate(model, database, footage.folder / "frames", work / "tracks", mapping)


def view_directions(views: Views, points: SparsePoints) -> np.ndarray:
    """(n, 3) unit vectors from the middle of the points to each camera, in the world."""
    d = views.centres - np.median(points.xyz, axis=0)
    return d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-12)


def spread_deg(views: Views, points: SparsePoints) -> float:
    """Largest angle between the directions from which the object was seen [degrees]."""
    d = view_directions(views, points)
    return float(np.rad2deg(np.arccos(np.clip((d @ d.T).min(), -1, 1))))


def _remarks(sizes: tuple[tuple[int, int], ...], registered: int, used: int, turned: float) -> list[str]:
    out = []
    if len(sizes) > 1:
        rest = ", ".join(str(n) for n, _ in sizes[1:])
        out.append(f"the images fell into {len(sizes)} models; the largest has {registered} images, the others {rest}")
    if registered < 0.5 * used:
        out.append(f"only {registered} of {used} images could be placed; sides seen in the others are missing")
    if turned < 60:
        out.append(
            f"the object is seen from directions within {turned:.0f} degrees only; most of its surface is not measured"
        )
    return out
