"""Photographs that the first model left out, added by what they share with the placed ones.

A model of few matches has few points, and an image is placed by points that it sees. Once the model has predicted where
further features match (`massprops.sfm.loops`), most features of the placed images are points, and the few matches of
an image that was left out find them. Each image must bear out its place: its matches with placed images were made
without it.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path

import numpy as np
import pycolmap

from massprops.core.progress import Progress, silent
from massprops.errors import NotPossible
from massprops.geometry.epipolar import fundamental, sampson
from massprops.sfm.attempt import Attempt, SfmOptions
from massprops.sfm.convert import to_views
from massprops.sfm.footage import FootageRecord
from massprops.sfm.loops import match_predicted
from massprops.sfm.mapping import continue_mapping

BORNE_OUT = 0.5
"""Share of an image's verified matches with placed ones that its place must agree with."""

REACH = 0.0125
"""Distance from the epipolar line at which a match agrees, in longer sides of the image: as far as matches are looked for
once poses are right."""

MOST_ROUNDS = 8


def extend(
    model: pycolmap.Reconstruction,
    found: Attempt,
    footage: FootageRecord,
    options: SfmOptions,
    work: Path,
    progress: Progress = silent,
) -> pycolmap.Reconstruction:
    """The model with the images that its points place, in rounds."""
    frames = footage.folder / "frames"
    for turn in range(MOST_ROUNDS):
        grown = continue_mapping(model, found.database, frames, work / f"more{turn}", found.mapping)
        known = set(model.reg_image_ids())
        take_out_contradicted(grown, found.database, known)
        fresh = {grown.image(i).name for i in set(grown.reg_image_ids()) - known}
        if not fresh:
            break
        try:
            model = match_predicted(grown, found, footage, options, work / f"more{turn}", progress, fresh)
        except NotPossible:
            break
    return model


def take_out_contradicted(model: pycolmap.Reconstruction, database: Path, known: set[int]) -> None:
    """Takes images out, in place, whose matches with the images `known` their place does not bear out."""
    manager = pycolmap.ObservationManager(model)
    for image_id, (agree, all_of) in borne_out(model, database, known).items():
        if agree < BORNE_OUT * all_of:
            manager.deregister_frame(model.image(image_id).frame_id)


def borne_out(model: pycolmap.Reconstruction, database: Path, known: set[int]) -> dict[int, tuple[int, int]]:
    """For each placed image that is not `known`, how many of its verified matches with known ones agree with its place,
    and how many there are."""
    views, ids = to_views(model)
    row = {image_id: i for i, image_id in enumerate(ids)}
    count = {i: np.zeros(2, int) for i in ids if i not in known}
    with pycolmap.Database.open(database) as db:
        for pair_id, geometry in zip(*db.read_two_view_geometries(), strict=True):
            a, b = pycolmap.pair_id_to_image_pair(pair_id)
            matches = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
            if not len(matches) or a not in row or b not in row or (a in known) == (b in known):
                continue
            x, y = (_pixels(db, i, matches[:, k]) for k, i in enumerate((a, b)))
            i, j = row[a], row[b]
            F = fundamental((views.K[i], views.K[j]), (views.R[i], views.R[j]), (views.t[i], views.t[j]))
            near = sampson(F, x, y) < REACH * float(views.size[j].max())
            count[b if a in known else a] += [int(near.sum()), len(near)]
    return {i: (int(c[0]), int(c[1])) for i, c in count.items()}


def _pixels(db: pycolmap.Database, image_id: int, index: np.ndarray) -> np.ndarray:
    """(k, 3) homogeneous places of features, centres of pixels at whole numbers."""
    places = np.asarray(db.read_keypoints(image_id), float)[index, :2] - 0.5
    return np.column_stack([places, np.ones(len(places))])
