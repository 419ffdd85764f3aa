"""From footage to one model: features, pairs, mapping, loops, last adjustment."""

from __future__ import annotations

import shutil
import zlib  # noqa: F401  must precede pycolmap
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pycolmap

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.sfm.attempt import ModelInputs, SfmOptions
from massprops.sfm.best_attempt import placed
from massprops.sfm.contradictions import contradictions
from massprops.sfm.film_starts import MappedFootage, best_start
from massprops.sfm.finer_features import with_finer_features
from massprops.sfm.footage import FootageRecord
from massprops.sfm.grown_film import (
    along_free_motion,
    apart,
    by_prediction,
    is_film,
    kept_matches,
    left_out,
    unfolded,
    with_pieces,
)
from massprops.sfm.held_focal import release, with_held_focal
from massprops.sfm.joined_models import join_models
from massprops.sfm.last_adjustment import SfmResult, corrected_by_shutter, finish, refine_options, with_shutter
from massprops.sfm.left_out_images import add_left_out_images
from massprops.sfm.loops import close_loops
from massprops.sfm.mapping import quiet
from massprops.sfm.pair_from_film import asks_for_film, by_film, film_of_first
from massprops.sfm.sound import require_sound, take_out


def reconstruct(
    footage: FootageRecord, work: Path, options: SfmOptions | None = None, progress: Progress = silent
) -> SfmResult:
    """Structure from motion of a footage; `work` is an empty folder for the database and raw models.

    A film that is refused is tried once more with its focal length held at first (`massprops.sfm.held_focal`).

    Raises:
        NotPossible: fewer than three images can be placed, or the views do not turn around the object.
        InputError: an image or a mask that cannot be used.
    """
    options = options or SfmOptions()
    quiet()
    try:
        return _reconstruct(footage, work, options, progress, None)
    except NotPossible:
        held = with_held_focal(footage)
        if held is None:
            raise
        shutil.rmtree(work)
        work.mkdir()
        with suppress(NotPossible):
            return _reconstruct(footage, work, options, progress, held)
        raise


def _reconstruct(
    footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress, held: FootageRecord | None
) -> SfmResult:
    """As `reconstruct`; held: the footage with a focal length to begin with."""

    def best(footage: FootageRecord, work: Path) -> MappedFootage:
        def begin(start: int, folder: Path) -> MappedFootage:
            return _mapped(footage, folder, replace(options, seed=options.seed + start), progress, held)

        return best_start(begin, footage, work)

    mapped = best(footage, work)
    if asks_for_film(mapped):
        with suppress(NotPossible):
            mapped = by_film(mapped, best(film_of_first(footage), work / "film"))
    return _finished(with_finer_features(mapped), progress)


def _mapped(
    footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress, held: FootageRecord | None
) -> MappedFootage:
    """Its images placed, before the last adjustment; held: the footage with a focal length to begin with.

    Raises:
        NotPossible: as `reconstruct`.
    """
    attempt = placed(held or footage, work, options, progress)
    if attempt.moved:  # what is about the object tells nothing of where it was
        footage = replace(footage, motion="tumbling")
    warnings = list(attempt.warnings)
    turning = footage.moving_pictures and footage.motion == "tumbling"
    tumbling = turning and is_film(footage)
    settings = refine_options(options, footage, attempt.mapping)
    options, model = replace(options, refine=settings), attempt.models[0]
    given = ModelInputs(attempt, held or footage, options, work, progress)
    require_sound(take_out(model, settings.given_focal)[2], settings.moving)
    first = attempt.database
    if attempt.special:
        first = kept_matches(attempt.database, work)
        model, attempt, more = by_prediction(model, given, first, tumbling)
        warnings += more
    else:
        model = close_loops(model, given)
        whole = model.num_reg_images()
        if turning:
            model, attempt = unfolded(model, given)
        if tumbling:
            model, more = with_pieces(model, attempt, given)
            warnings += more
    grown_otherwise = attempt is not given.found
    given = replace(given, found=attempt)
    if held is not None:
        given = release(model, given, footage)
    along = along_free_motion(model, given) if tumbling and len(footage.cameras) == 1 else None
    if along is not None:
        model, following = along
        given = replace(
            given, options=replace(given.options, refine=replace(given.options.refine, following=following))
        )
    if grown_otherwise and not attempt.special:
        warnings += left_out(whole - model.num_reg_images())
    if not footage.moving_pictures and model.num_reg_images() < len(footage.frames):
        model = add_left_out_images(model, given)
        if not (attempt.repeats or attempt.matches_required):
            model = join_models(model, apart(model, attempt.models), given)
    return MappedFootage(model, given, first, warnings)


def _finished(mapped: MappedFootage, progress: Progress) -> SfmResult:
    """The last adjustment, and what is said of it.

    Raises:
        NotPossible: the views do not turn around the object.
    """
    model, given, warnings = mapped.model, mapped.given, mapped.warnings
    footage, attempt, options = given.footage, given.found, given.options
    sizes = tuple((m.num_reg_images(), m.num_points3D()) for m in (model, *apart(model, attempt.models)))
    before = pycolmap.Reconstruction(model)
    result = finish(model, footage, attempt.mapping, options, sizes, list(warnings), progress)
    result = with_shutter(corrected_by_shutter(result, before, given, sizes, warnings))
    against = contradictions(model, attempt.database if footage.background == "black" else mapped.first)
    objections = against.said({f.name: f.source_name for f in footage.frames})
    masked = attempt.mapping.masked
    return replace(
        result,
        against=against,
        matches_required=attempt.matches_required,
        masked=masked,
        unsure=mapped.unsure,
        warnings=(*result.warnings, *objections),
    )
