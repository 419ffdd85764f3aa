"""From footage to one model: features, pairs, mapping, loops, last adjustment."""

from __future__ import annotations

import shutil
import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from massprops.core.progress import Progress, silent
from massprops.core.text import counted
from massprops.dense.region import Region, region_of
from massprops.errors import InputError, NotPossible
from massprops.sfm.along_motion import Following, follow_free_motion, refine_along
from massprops.sfm.attempt import (
    ENOUGH,
    Attempt,
    ModelInputs,
    SfmOptions,
    Way,
    attempt,
    count_images,
    independent_models,
    jumps,
    may_distort,
    steady,
    steady_images,
    steady_parts,
)
from massprops.sfm.contradicted import without_contradictions
from massprops.sfm.contradictions import Contradictions, contradictions
from massprops.sfm.convert import take_out_images, to_points, to_views
from massprops.sfm.features import is_plain, read_mask
from massprops.sfm.firm_part import firm_part
from massprops.sfm.footage import FootageRecord
from massprops.sfm.free_run import SHORTEST
from massprops.sfm.global_shutter import to_global_shutter
from massprops.sfm.joined_models import join_models
from massprops.sfm.joined_pieces import join_pieces
from massprops.sfm.left_out_images import add_left_out_images, take_out_unsupported
from massprops.sfm.lens import MODELS, LensChoice
from massprops.sfm.loops import close_loops, match_predicted, spread_deg
from massprops.sfm.mapping import MappingOptions, quiet
from massprops.sfm.points import SparsePoints
from massprops.sfm.precision import Precision
from massprops.sfm.predicted_images import add_predicted_images
from massprops.sfm.refine import Refined, RefineOptions, refine
from massprops.sfm.rolling_shutter import Settings, Shutter, find_shutter, frame_times
from massprops.sfm.row_motion import Seen
from massprops.sfm.sound import flat_remarks, require_sound, take_out
from massprops.sfm.surface_tracks import PIXELS, ROOM_PIXELS, Image, with_surface
from massprops.sfm.turned import turn_image, upright
from massprops.sfm.verified_matches import MANY
from massprops.views import Views, undistort

FOLLOWED = 3
"""Rounds in which a motion is followed: each matches at their predicted places what the one before has placed."""


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
        against: the pairs of images whose matches contradict the model.
        believed_from: where sides look alike, the matches that a pair of images needed to be believed; 0 elsewhere.
        masked: only features within the silhouettes were used.
        shutter: how the shutter reads an image's rows.
        seen: the model by which its motion is known, where it does so one after the other.
        corrected: folder with `frames/` and `masks/` as a global shutter would have taken them, where that was needed.
    """

    model: pycolmap.Reconstruction
    views: Views
    points: SparsePoints
    models: tuple[tuple[int, int], ...]
    precision: Precision
    cameras: tuple[SolvedCamera, ...]
    warnings: tuple[str, ...]
    against: Contradictions = Contradictions(0.0, ())
    believed_from: int = 0
    masked: bool = False
    shutter: Shutter = Shutter("unknown")
    seen: Seen | None = None
    corrected: Path | None = None


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
    found = _placed(footage, work, options, progress)
    if found.moved:  # what is about the object tells nothing of where it was
        footage = replace(footage, motion="tumbling")
    warnings = list(found.warnings)
    tumbling = _is_film(footage) and footage.motion == "tumbling"
    settings = refine_options(options, footage, found.mapping)
    options, model = replace(options, refine=settings), found.models[0]
    given = ModelInputs(found, footage, options, work, progress)
    require_sound(take_out(model, settings.given_focal)[2], settings.moving)
    first = found.database
    if found.special:
        first = _kept_matches(found.database, work)
        model, found, more = _by_prediction(model, given, first, tumbling)
        warnings += more
    else:
        model = close_loops(model, given)
        whole = model.num_reg_images()
        if tumbling:
            model, found = _unfolded(model, given)
            model, more = _with_pieces(model, found, given)
            warnings += more
    along = _along_free_motion(model, given) if tumbling and len(footage.cameras) == 1 else None
    if along is not None:
        model, following = along
        options = replace(options, refine=replace(options.refine, following=following))
    if found is not given.found and not found.special:
        warnings += _left_out(whole - model.num_reg_images())
    if not footage.moving_pictures and model.num_reg_images() < len(footage.frames):
        model = add_left_out_images(model, given)
        if not (found.repeats or found.believed_from):
            model = join_models(model, _apart(model, found.models), given)
    sizes = tuple((m.num_reg_images(), m.num_points3D()) for m in (model, *_apart(model, found.models)))
    mapped = pycolmap.Reconstruction(model)
    result = finish(model, footage, found.mapping, options, sizes, list(warnings), progress)
    result = _with_shutter(_corrected(result, mapped, given, sizes, warnings))
    against = contradictions(model, found.database if footage.background == "black" else first)
    said = against.said({f.name: f.source_name for f in footage.frames})
    masked = found.mapping.masked
    return replace(
        result, against=against, believed_from=found.believed_from, masked=masked, warnings=(*result.warnings, *said)
    )


def _is_film(footage: FootageRecord) -> bool:
    return footage.moving_pictures and not footage.rig


def _kept_matches(database: Path, work: Path) -> Path:
    """A copy of a database whose matches were made without a model: those at predicted places bear out any model that predicts them."""
    return Path(shutil.copy(database, work / "without_a_model.db"))


def _by_prediction(
    model: pycolmap.Reconstruction, given: ModelInputs, first: Path, tumbling: bool
) -> tuple[pycolmap.Reconstruction, Attempt, list[str]]:
    """The model grown by matches that it predicts, what was found, and what is said of it.

    A free body's motion leads to the next image. A hand with a camera goes less evenly: of a film on a printed cloth, images
    predicted by its motion were placed up to four cells of the print off. So its model is grown from the part that many points hold, and what
    is unique in each further image is asked first, as in photographs.

    Args:
        first: the matches that were made without a model.
    """
    found, footage, more = given.found, given.footage, list[str]()
    still = _is_film(footage) and found.repeats and not tumbling
    if still:
        model = firm_part(model, [f.name for f in footage.frames], MappingOptions().least_inliers)
    model = match_predicted(model, given, given.work)
    if tumbling:
        model, found = _steady_part(model, given)
    if still and model.num_reg_images() < len(footage.frames):
        model = add_left_out_images(model, replace(given, work=given.work / "unique"), len(footage.frames))
    if _is_film(footage) and model.num_reg_images() < len(footage.frames):
        known = set(model.reg_image_ids())
        model = _followed(model, given)
        if still:
            take_out_unsupported(model, first, known)
    if tumbling:
        model, more = _with_pieces(model, found, given)
    return model, found, more


def _placed(footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress) -> Attempt:
    """The way that places most images and is borne out by its matches.

    Raises:
        NotPossible: fewer than three images can be placed.
    """
    found = _best(footage, work, options, progress)
    if found.registered < 3 and found.mapping.masked and is_plain(footage, found.features):
        raise NotPossible(
            "the object is plain: next to nothing on its surface can be told apart from image to image; light it from the side, "
            "put marks or powder on it, or give the poses of its images with --sparse, so that its outlines show its shape"
        )
    if found.registered < 3:
        raise NotPossible(
            f"only {found.registered} of {len(footage.frames)} images could be placed; give more images with more "
            "overlap (under 15 degrees between neighbours), sharper or better lit"
        )
    if footage.moving_pictures or footage.rig or found.repeats:
        return found
    return without_contradictions(found, footage, work / "f", options, progress)


def _corrected(
    result: SfmResult,
    mapped: pycolmap.Reconstruction,
    given: ModelInputs,
    sizes: tuple[tuple[int, int], ...],
    warnings: list[str],
) -> SfmResult:
    """The last adjustment once more on features and images as a global shutter would have given them, where one is missing.

    Args:
        result: of the adjustment without.
        mapped: the model before it; is changed.
        sizes, warnings: as `finish` takes them.
    """
    shutter = result.shutter
    if shutter.state != "rolling" or result.seen is None or shutter.readout is None:
        return result
    try:
        footage = to_global_shutter(mapped, result.seen, shutter.readout, given)
        again = finish(mapped, footage, given.found.mapping, given.options, sizes, list(warnings), given.progress)
    except NotPossible:  # the images hold together as they are, and not as they are thought to be
        return replace(result, shutter=replace(shutter, state="suspected"))
    remains = bool(again.shutter.said())
    return replace(again, shutter=replace(shutter, remains=remains), corrected=footage.folder)


def _with_shutter(result: SfmResult) -> SfmResult:
    """What the shutter says to the user, and how much less sure the focal length is for it."""
    shutter = result.shutter
    sigma = shutter.focal_sigma_relative
    if not sigma:
        return result
    precision, cameras = result.precision, result.cameras
    by_camera = {c: float(np.hypot(s, sigma)) for c, s in precision.focal_by_camera.items()}
    precision = replace(
        precision, focal_relative=float(np.hypot(precision.focal_relative, sigma)), focal_by_camera=by_camera
    )
    cameras = tuple(replace(c, focal_sigma_relative=float(np.hypot(c.focal_sigma_relative, sigma))) for c in cameras)
    return replace(result, precision=precision, cameras=cameras, warnings=(*result.warnings, shutter.said()))


def _apart(model: pycolmap.Reconstruction, models: list[pycolmap.Reconstruction]) -> list[pycolmap.Reconstruction]:
    """The smaller models, without those whose images the largest has taken in."""
    placed = {model.image(i).name for i in model.reg_image_ids()}
    return [m for m in models[1:] if any(m.image(i).name not in placed for i in m.reg_image_ids())]


def _steady_part(model: pycolmap.Reconstruction, given: ModelInputs) -> tuple[pycolmap.Reconstruction, Attempt]:
    """The largest part of a model that turns steadily, matched by itself, and what was found, with the other parts as models of their
    own; both as they are where the model has no jump."""
    first, *others = steady_parts(model, given.footage, given.found.mapping)
    if first is model:
        return model, given.found
    model = match_predicted(first, given, given.work / "steady")
    return model, replace(given.found, models=[model, *others, *given.found.models[1:]])


def _unfolded(model: pycolmap.Reconstruction, given: ModelInputs) -> tuple[pycolmap.Reconstruction, Attempt]:
    """A film's model, and what was found. Where its turning jumps, and matches contradict it or nothing can hold the body, it is cut at
    the jumps and followed anew from its largest part, and the other parts are models of their own.

    Where sides look alike, more matches may bear out that they are one than tell them apart: a figure with four such sides was placed
    on two of them, and 0.10 of the matches contradict that, 0.18 where it stands rightly. Two sides of crinkled foil share a few features by
    chance, and no match contradicts them; but what flies before a black sky does not jump. A cut that leaves less than half of the images
    does not tell which of its parts are right.
    """
    found, footage = given.found, given.footage
    flies = footage.background == "black"
    if not jumps(model, footage) or (not flies and contradictions(model, found.database).share < MANY):
        return model, found
    cut, others = _steady_part(model, given)
    try:
        grown = _followed(cut, replace(given, found=others))
    except NotPossible:
        grown = cut
    if flies and 2 * grown.num_reg_images() < model.num_reg_images():
        return model, found
    return grown, others


def _with_pieces(
    model: pycolmap.Reconstruction, found: Attempt, given: ModelInputs
) -> tuple[pycolmap.Reconstruction, list[str]]:
    """The model with the pieces that its motion and surface join, and what is said of that."""
    before = model.num_reg_images()
    model = join_pieces(model, _apart(model, found.models), given)
    if model.num_reg_images() <= before:
        return model, []
    return model, [
        f"the film fell into pieces that share too few features, the largest of {before} images: they were joined by the "
        "body's free motion and by the surface that two pieces show"
    ]


def _along_free_motion(
    model: pycolmap.Reconstruction, given: ModelInputs
) -> tuple[pycolmap.Reconstruction, Following] | None:
    """The images placed by the body's free motion, and that, where its cells repeat, or where it flies before a black sky and many images
    of it are not placed yet; None where it is not needed, too few tell it, it places no more images, or the body does not move so.

    On crinkled foil the images of a bright side match each other falsely, and what is then placed by itself stands still or turns
    back, while the motion through the images that are right leads to all others.
    """
    if given.found.repeats:
        return follow_free_motion(model, given)
    # one in the Earth's shadow shows nothing to place it by
    lit = sum(len(places) >= given.options.refine.fewest for places, _ in given.found.features.values())
    placed = model.num_reg_images()
    if given.footage.background != "black" or not SHORTEST <= placed < ENOUGH * lit:
        return None
    along = follow_free_motion(model, given)
    return along if along is not None and along[0].num_reg_images() > placed else None


def _left_out(lost: int) -> list[str]:
    """What is said of images that a cut film has lost."""
    if lost < 1:
        return []
    return [
        f"two sides of the body look alike, and {counted(lost, 'image', 'images')} that had been placed on the wrong one could not be "
        "placed where its motion leads: film with shorter steps, or mark one of these sides"
    ]


def _followed(model: pycolmap.Reconstruction, given: ModelInputs) -> pycolmap.Reconstruction:
    """The model with the images that its motion leads to, as far as they follow each other as motion lets them.

    Images far from the first model are held by little until all are matched at their predicted places; what lies beyond a jump
    is left to the next round.
    """
    for turn in range(FOLLOWED):
        core = frozenset(model.reg_image_ids())
        rounds = replace(given, work=given.work / f"following{turn}")
        grown = add_predicted_images(model, rounds)
        keep = steady_images(grown, given.footage, given.found.mapping, core)
        if not keep > core:
            break
        take_out_images(grown, set(grown.reg_image_ids()) - keep)
        model = match_predicted(grown, given, rounds.work / "grown")
        if model.num_reg_images() == len(given.footage.frames):
            break
    return model


def _best(footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress) -> Attempt:
    """The way that places most images: the usual one, one without the background, one with fainter features.

    Raises:
        NotPossible: none finds a pair of images to start from.
    """
    used, masked = len(footage.frames), footage.mask_features and footage.has_masks
    found, why = None, None
    try:
        found = attempt(footage, work / "a", options, masked, progress=progress)
    except NotPossible as error:
        why = error
    if found and not masked and footage.has_masks and found.registered < 0.8 * used:
        again = attempt(footage, work / "b", options, True, progress=progress)
        if again.registered > found.registered:
            line = "only the object's own features were used: with the background fewer images fit together"
            found = replace(again, warnings=[*again.warnings, line])
    room = masked and footage.room_stood
    if found and room and found.registered < ENOUGH * used:
        found = _with_the_room(footage, work / "b", options, found, "usual", progress)
    if found and (found.registered >= ENOUGH * used or not found.few):
        return found
    if masked and footage.moving_pictures:
        found = _enlarged(footage, work / "d", options, found, progress)
        if found and found.covered >= ENOUGH * used:
            return found
    try:
        again = attempt(footage, work / "c", options, found.mapping.masked if found else masked, "faint", progress)
    except NotPossible:
        if found is None and why is not None:
            raise why from None
        again = None
    more = again is not None and again.registered > (found.registered if found else 0)
    if again and more and (not footage.moving_pictures or steady(again.models[0], footage, again.mapping)):
        found = again
    if found is None:
        raise why or NotPossible("no two images fit together; use more overlap and texture")
    if room and found.mapping.masked and found.registered < ENOUGH * used:
        return _with_the_room(footage, work / "e", options, found, "faint", progress)
    return found


def _with_the_room(
    footage: FootageRecord, work: Path, options: SfmOptions, found: Attempt, way: Way, progress: Progress
) -> Attempt:
    """What the surroundings and the object place together, where that is more, and contradicts nothing that the object shows."""
    try:
        again = attempt(footage, work, options, False, way, progress)
    except NotPossible:
        return found
    if again.registered <= found.registered or contradictions(again.models[0], again.database).share >= MANY:
        return found
    line = "the surroundings were used too: by the object's own features alone fewer images fit together"
    return replace(again, warnings=[*again.warnings, line])


def _enlarged(
    footage: FootageRecord, work: Path, options: SfmOptions, found: Attempt | None, progress: Progress
) -> Attempt | None:
    """What features of enlarged images of a body come to, where its models hold more images together, or as many in fewer."""
    try:
        again = attempt(footage, work, options, True, "enlarged", progress)
    except NotPossible:
        return found
    if found is None:
        return again
    before = independent_models(found.models, footage, found.mapping)
    now = independent_models(again.models, footage, again.mapping)
    held = [(count_images(p), p[0].num_reg_images() if p else 0) for p in (before, now)]
    return replace(again, models=now) if now and held[1] >= held[0] else found


def refine_options(options: SfmOptions, footage: FootageRecord, mapping: MappingOptions) -> RefineOptions:
    """How this footage's model is adjusted."""
    given = mapping.fixed_intrinsics or bool(mapping.constant)
    on_table = footage.background != "black"
    return replace(
        options.refine, constant=mapping.constant, given_focal=given, moving=_moving(footage), on_table=on_table
    )


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
    settings = refine_options(options, footage, mapping)
    test = free and may_distort(footage)
    if settings.following is None:
        refined = refine(model, settings, free, test, options.threads, masked, options.seed)
    else:
        refined = refine_along(model, settings.following, settings, free)
    accuracy = refined.precision
    if free and not mapping.constant:
        warnings += flat_remarks(to_points(model, to_views(model)[1]), accuracy.focal_relative)
    how = Settings(settings, free, refined.radial_terms, options.seed, options.threads)
    shutter, seen = Shutter("unknown"), None
    if settings.following is None:
        accuracy, shutter, seen = _on_surface(model, footage, accuracy, how, masked, progress)
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
            counted(sizes[0][0] - len(views), "image was", "images were")
            + " taken out again: too few points tie it to the rest"
        )
    warnings += _remarks(sizes, len(views), used, turned)
    return SfmResult(model, views, points, sizes, accuracy, cameras, tuple(warnings), shutter=shutter, seen=seen)


def _on_surface(
    model: pycolmap.Reconstruction,
    footage: FootageRecord,
    before: Precision,
    how: Settings,
    masked: bool,
    progress: Progress,
) -> tuple[Precision, Shutter, Seen | None]:
    """The model adjusted in place with tracks of the surface, where there is one: its precision, and what these say of the
    shutter."""
    image, pixels = _surface_pictures(footage, to_views(model)[0], masked)
    if image is None:
        return before, Shutter("unknown"), None
    surface = with_surface(
        model,
        before,
        image,
        how.options,
        how.free_focal,
        how.radial_terms,
        pixels,
        how.seed,
        how.threads,
        progress,
    )
    times = frame_times(footage)
    if surface.pieces is None or times is None:
        return surface.precision, Shutter("unknown"), None
    return surface.precision, *find_shutter(surface.pieces, times, how)


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


def _surface_pictures(footage: FootageRecord, views: Views, masked: bool) -> tuple[Image | None, int]:
    """The images that show a surface which stands with the model, and how many pixels of each to look at.

    Where the room was used, what stands is what the cameras look at. A body that turns before a still background takes
    part in its own silhouettes only.
    """
    if masked:
        return _pictures(footage, views, None), PIXELS
    if footage.room_stood:
        return _pictures(footage, views, region_of(views)), ROOM_PIXELS
    return None, 0


def _pictures(footage: FootageRecord, views: Views, region: Region | None) -> Image:
    """The views undistorted, turned as their camera's are, with their silhouettes or what they see of the region; one without a
    silhouette shows nothing."""
    frames = {f.name: f for f in footage.frames}

    def image(i: int) -> tuple[np.ndarray, np.ndarray]:
        frame = frames[views.names[i]]
        size = footage.size(frame)
        colour = cv2.imread(str(footage.image(frame.name)))
        if colour is None:
            raise InputError(f"{footage.image(frame.name)}: not a readable image; run the capture stage again")
        K, distortion = views.K[i], views.distortion[i]
        colour = undistort(turn_image(colour, frame.turn), K, distortion)
        if region is not None:
            return colour, region.mask(views, i)
        mask = read_mask(footage, frame.name, size)
        if mask is None:
            mask = np.zeros((size[1], size[0]), np.uint8)
        return colour, undistort(turn_image(mask, frame.turn), K, distortion, nearest=True)

    return image


def _remarks(sizes: tuple[tuple[int, int], ...], registered: int, used: int, turned: float) -> list[str]:
    out = []
    if len(sizes) > 1:
        rest = ", ".join(str(n) for n, _ in sizes[1:])
        out.append(
            f"the images fell into {len(sizes)} models that do not connect: the largest, of {registered} images, is used, "
            f"and not the others ({rest}); more overlap between neighbouring images would connect them"
        )
    if registered < 0.5 * used:
        out.append(f"only {registered} of {used} images could be placed; sides seen in the others are missing")
    if turned < 60:
        out.append(
            f"the object is seen from directions within {turned:.0f} degrees only; most of its surface is not measured"
        )
    return out
