"""The attempt that places most of a footage's images."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace
from pathlib import Path

from massprops.core.progress import Progress
from massprops.errors import NotPossible
from massprops.sfm.attempt import ENOUGH, Attempt, SfmOptions, Way, attempt, count_images, independent_models, steady
from massprops.sfm.contradicted import without_contradictions
from massprops.sfm.contradictions import contradictions
from massprops.sfm.features import is_plain
from massprops.sfm.footage import FootageRecord
from massprops.sfm.verified_matches import MANY


def placed(footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress) -> Attempt:
    """The way that places most images and is borne out by its matches.

    Raises:
        NotPossible: fewer than three images can be placed.
    """
    best = _best(footage, work, options, progress)
    if best.registered < 3 and best.mapping.masked and is_plain(footage, best.features):
        raise NotPossible(
            "the object is plain: next to nothing on its surface can be told apart from image to image; light it from the side, "
            "put marks or powder on it, or give its attitudes (attitude0 of a sequence folder) or the poses of its images (--sparse), so that "
            "its outlines show its shape"
        )
    if best.registered < 3:
        raise NotPossible(
            f"only {best.registered} of {len(footage.frames)} images could be placed; give more images with more "
            "overlap (under 15 degrees between neighbours), sharper or better lit"
        )
    if footage.moving_pictures or footage.rig or best.repeats:
        return best
    return without_contradictions(best, footage, work / "f", options, progress)


def _best(footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress) -> Attempt:
    """The way that places most images: the usual one, one without the background, one with fainter features.

    Raises:
        NotPossible: none finds a pair of images to start from.
    """
    used, masked = len(footage.frames), footage.mask_features and footage.has_masks
    best, why = None, None
    try:
        best = attempt(footage, work / "a", options, masked, progress=progress)
    except NotPossible as error:
        why = error
    if best and not masked and footage.has_masks and best.registered < 0.8 * used:
        again = attempt(footage, work / "b", options, True, progress=progress)
        if again.registered > best.registered:
            line = "only the object's own features were used: with the background fewer images fit together"
            best = replace(again, warnings=[*again.warnings, line])
    room = masked and footage.room_stood
    if best and room and best.registered < ENOUGH * used:
        best = _with_the_room(footage, work / "b", options, best, "usual", progress)
    if best and (best.registered >= ENOUGH * used or not best.few):
        return best
    if masked and footage.moving_pictures:
        best = _enlarged(footage, work / "d", options, best, progress)
        if best and best.covered >= ENOUGH * used:
            return best
    try:
        again = attempt(footage, work / "c", options, best.mapping.masked if best else masked, "faint", progress)
    except NotPossible:
        if best is None and why is not None:
            raise why from None
        again = None
    more = again is not None and again.registered > (best.registered if best else 0)
    if again and more and (not footage.moving_pictures or steady(again.models[0], footage, again.mapping)):
        best = again
    if best is None:
        raise why or NotPossible("no two images fit together; use more overlap and texture")
    if room and best.mapping.masked and best.registered < ENOUGH * used:
        return _with_the_room(footage, work / "e", options, best, "faint", progress)
    return best


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
