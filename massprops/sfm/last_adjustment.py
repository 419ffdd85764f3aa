"""The last adjustment of a mapped model, and what is said of it."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap

from massprops.core.progress import Progress, silent
from massprops.core.text import counted
from massprops.errors import NotPossible
from massprops.sfm.along_motion import refine_along
from massprops.sfm.attempt import ModelInputs, SfmOptions, may_distort
from massprops.sfm.contradictions import Contradictions
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.footage import FootageRecord
from massprops.sfm.global_shutter import to_global_shutter
from massprops.sfm.lens import MODELS, LensChoice
from massprops.sfm.loops import spread_deg
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.points import SparsePoints
from massprops.sfm.precision import Precision
from massprops.sfm.refine import Refined, RefineOptions, refine
from massprops.sfm.rolling_shutter import Settings, Shutter, find_shutter, frame_times
from massprops.sfm.row_motion import Seen
from massprops.sfm.sound import flat_remarks
from massprops.sfm.surface_pictures import surface_pictures
from massprops.sfm.surface_tracks import with_surface
from massprops.sfm.turned import upright
from massprops.views import Views


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
        matches_required: where sides look alike, the matches that a pair of images needed to be believed; 0 elsewhere.
        masked: only features within the silhouettes were used.
        shutter: how the shutter reads an image's rows.
        seen: the model by which its motion is known, where it does so one after the other.
        unsure: a film was mapped several times, no two results agree, and none convinces.
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
    matches_required: int = 0
    masked: bool = False
    shutter: Shutter = Shutter("unknown")
    seen: Seen | None = None
    unsure: bool = False
    corrected: Path | None = None


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
    image, pixels = surface_pictures(footage, to_views(model)[0], masked)
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
        of_camera = np.flatnonzero(number == record.id + 1)
        if not len(of_camera):
            continue
        lens = refined.lenses.get(record.id + 1)
        K = views.K[of_camera[0]]
        out.append(
            SolvedCamera(
                record.id,
                len(of_camera),
                (float(K[0, 0]), float(K[1, 1])),
                float(accuracy.focal_by_camera.get(record.id + 1, 0.0)),
                tuple(float(k) for k in views.distortion[of_camera[0]]),
                lens or LensChoice(MODELS[0] if record.distortion is None else "OPENCV"),
                lens is not None and lens.bent,
            )
        )
    return tuple(sorted(out, key=lambda c: (-c.images, c.id)))


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


def corrected_by_shutter(
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


def with_shutter(result: SfmResult) -> SfmResult:
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
