"""A film's first model grown to its other images: by matches that it predicts, and by the motion that it shows."""

from __future__ import annotations

import shutil
import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap

from massprops.core.text import counted
from massprops.errors import NotPossible
from massprops.sfm.along_motion import CONVINCES, Following, follow_free_motion, strays
from massprops.sfm.attempt import ENOUGH, Attempt, ModelInputs, jumps, steady_images, steady_parts
from massprops.sfm.contradictions import contradictions
from massprops.sfm.convert import take_out_images, to_views
from massprops.sfm.firm_part import firm_part
from massprops.sfm.footage import FootageRecord
from massprops.sfm.free_run import SHORTEST
from massprops.sfm.joined_pieces import join_pieces
from massprops.sfm.left_out_images import add_left_out_images, take_out_unsupported
from massprops.sfm.loops import match_predicted
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.predicted_images import add_predicted_images
from massprops.sfm.verified_matches import MANY

STRAY_DEG = 0.1
"""How far all of a film's attitudes must lie from one free motion for that to be followed in their place. Of a bus and a rock (Blender) whose
attitudes were right they lay .005 to .08 degrees off, as far as their errors were stated, and of the bus by heavy compression .3, where they
were wrong by 2 and 5; the motion that was followed then was wrong by .2 and .5."""

FOLLOWED = 3
"""Rounds in which a motion is followed: each matches at their predicted places what the one before has placed."""


def is_film(footage: FootageRecord) -> bool:
    """Whether one camera's moving pictures were given."""
    return footage.moving_pictures and not footage.rig


def apart(model: pycolmap.Reconstruction, models: list[pycolmap.Reconstruction]) -> list[pycolmap.Reconstruction]:
    """The smaller models, without those whose images the largest has taken in."""
    placed = {model.image(i).name for i in model.reg_image_ids()}
    return [m for m in models[1:] if any(m.image(i).name not in placed for i in m.reg_image_ids())]


def kept_matches(database: Path, work: Path) -> Path:
    """A copy of a database whose matches were made without a model: those at predicted places bear out any model that predicts them."""
    return Path(shutil.copy(database, work / "without_a_model.db"))


def by_prediction(
    model: pycolmap.Reconstruction, given: ModelInputs, first: Path, tumbling: bool
) -> tuple[pycolmap.Reconstruction, Attempt, list[str]]:
    """The model grown by matches that it predicts, what was found, and what is said of it.

    A free body's motion leads to the next image. A hand with a camera goes less evenly: of a film on a printed cloth, images
    predicted by its motion were placed up to four cells of the print off. So its model is grown from the part that many points hold, and what
    is unique in each further image is asked first, as in photographs, unless matches speak for all of it.

    Args:
        first: the matches that were made without a model.
    """
    still = is_film(given.footage) and given.found.repeats and not tumbling
    if not still:
        return _grown(model, given, tumbling)
    whole, names = model, [f.name for f in given.footage.frames]
    firm = firm_part(whole, names, MappingOptions().least_inliers)
    model, attempt, more = _grown(firm, given, tumbling, first)
    if firm is not whole:
        model = _less_contradicted(model, whole, given, first)
    return model, attempt, more


def _less_contradicted(
    model: pycolmap.Reconstruction, whole: pycolmap.Reconstruction, given: ModelInputs, first: Path
) -> pycolmap.Reconstruction:
    """A still film's model, grown from the part that many points hold, or where matches made without a model, `first`, contradict it,
    that from all that was placed at first, if it places as many images and is contradicted less. The database then holds its matches.

    What holds by few points may be right: of a jug on a cloth 37 of 56 images were, once 25 of them had been placed anew, and all were before.
    """
    against = contradictions(model, first).share
    if not against:
        return model
    work, database = given.work / "whole", given.found.database
    work.mkdir()
    before = shutil.copy(database, work / "firm.db")
    shutil.copy(first, database)
    try:
        other = _grown(whole, replace(given, work=work), False, first)[0]
    except NotPossible:
        other = None
    if (
        other is not None
        and other.num_reg_images() >= model.num_reg_images()
        and contradictions(other, first).share < against
    ):
        return other
    shutil.copy(before, database)
    return model


def _grown(
    model: pycolmap.Reconstruction, given: ModelInputs, tumbling: bool, first: Path | None = None
) -> tuple[pycolmap.Reconstruction, Attempt, list[str]]:
    """As `by_prediction`, from this model; first: of a still film on a print, the matches that were made without a model, else None."""
    attempt, footage, more = given.found, given.footage, list[str]()
    model = match_predicted(model, given, given.work)
    if tumbling:
        model, attempt = _steady_part(model, given)
    if first is not None and model.num_reg_images() < len(footage.frames):
        model = add_left_out_images(model, replace(given, work=given.work / "unique"), len(footage.frames))
    if is_film(footage) and model.num_reg_images() < len(footage.frames):
        known = set(model.reg_image_ids())
        model = _followed(model, given)
        if first is not None:
            take_out_unsupported(model, first, known)
    if tumbling:
        model, more = with_pieces(model, attempt, given)
    return model, attempt, more


def unfolded(model: pycolmap.Reconstruction, given: ModelInputs) -> tuple[pycolmap.Reconstruction, Attempt]:
    """A film's model, and what was found. Where its turning jumps, and matches contradict it or nothing can hold the body, it is cut at
    the jumps and followed anew from its largest part, and the other parts are models of their own.

    Where sides look alike, more matches may bear out that they are one than tell them apart: a figure with four such sides was placed
    on two of them, and 0.10 of the matches contradict that, 0.18 where it stands rightly. Two sides of crinkled foil share a few features by
    chance, and no match contradicts them; but what flies before a black sky does not jump. A cut that leaves less than half of the images
    does not tell which of its parts are right.
    """
    attempt, footage = given.found, given.footage
    flies = footage.background == "black"
    if not jumps(model, footage) or (not flies and contradictions(model, attempt.database).share < MANY):
        return model, attempt
    cut, others = _steady_part(model, given)
    try:
        grown = _followed(cut, replace(given, found=others))
    except NotPossible:
        grown = cut
    if flies and 2 * grown.num_reg_images() < model.num_reg_images():
        return model, attempt
    return grown, others


def _steady_part(model: pycolmap.Reconstruction, given: ModelInputs) -> tuple[pycolmap.Reconstruction, Attempt]:
    """The largest part of a model that turns steadily, matched by itself, and what was found, with the other parts as models of their
    own; both as they are where the model has no jump."""
    first, *others = steady_parts(model, given.footage, given.found.mapping)
    if first is model:
        return model, given.found
    model = match_predicted(first, given, given.work / "steady")
    return model, replace(given.found, models=[model, *others, *given.found.models[1:]])


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


def left_out(lost: int) -> list[str]:
    """What is said of images that a cut film has lost."""
    if lost < 1:
        return []
    return [
        f"two sides of the body look alike, and {counted(lost, 'image', 'images')} that had been placed on the wrong one could not be "
        "placed where its motion leads: film with shorter steps, or mark one of these sides"
    ]


def with_pieces(
    model: pycolmap.Reconstruction, found: Attempt, given: ModelInputs
) -> tuple[pycolmap.Reconstruction, list[str]]:
    """The model with the pieces that its motion and surface join, and what is said of that."""
    before = model.num_reg_images()
    model = join_pieces(model, apart(model, found.models), given)
    if model.num_reg_images() <= before:
        return model, []
    return model, [
        f"the film fell into pieces that share too few features, the largest of {before} images: they were joined by the "
        "body's free motion and by the surface that two pieces show"
    ]


def along_free_motion(
    model: pycolmap.Reconstruction, given: ModelInputs
) -> tuple[pycolmap.Reconstruction, Following] | None:
    """The images placed by the body's free motion, and that, where its cells repeat, or where it flies before a black sky and many images
    of it are not placed yet, or stray from a free motion; None where it is not needed, too few tell it, it neither places more images nor
    convinces, or the body does not move so.

    On crinkled foil the images of a bright side match each other falsely, and what is then placed by itself stands still or turns
    back, while the motion through the images that are right leads to all others. A codec's errors are alike in neighbouring images: their
    own poses drift.
    """
    if not _asks_for_motion(model, given):
        return None
    # a motion matches all images anew, which bears out the model that was placed by it alone
    database = given.found.database
    before = shutil.copy(database, database.with_name("before_motion.db"))
    along = follow_free_motion(model, given)
    if along is not None and (given.found.repeats or _leads(along, model.num_reg_images())):
        return along
    shutil.copy(before, database)
    return None


def _asks_for_motion(model: pycolmap.Reconstruction, given: ModelInputs) -> bool:
    """Whether cells repeat, or what flies before a black sky is not placed yet in many images, or strays from a free motion."""
    if given.found.repeats:
        return True
    placed = model.num_reg_images()
    if given.footage.background != "black" or placed < SHORTEST:
        return False
    nearly_all = placed >= ENOUGH * len(given.images_with_features)
    return not nearly_all or strays_from_motion(model, given.footage)


def strays_from_motion(model: pycolmap.Reconstruction, footage: FootageRecord) -> bool:
    """Whether the first camera's attitudes lie farther from one free motion than those that are right (`STRAY_DEG`)."""
    views = to_views(model)[0]
    return strays(views.take(views.of_first_camera), footage.times.__getitem__) >= np.deg2rad(STRAY_DEG)


def _leads(along: tuple[pycolmap.Reconstruction, Following], placed: int) -> bool:
    """Whether a motion places more images than the `placed` ones, or as many and convinces."""
    followed, following = along
    more = followed.num_reg_images() - placed
    return more > 0 or (more == 0 and following.gain < CONVINCES)
