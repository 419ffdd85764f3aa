"""Photographs that the first model left out: added by the points that they share with the placed images.

A model of few matches has few points, and an image is placed by points that it sees. Once the model has predicted where
further features match (`massprops.sfm.loops`), most features of the placed images are points, and the few matches of
an image that was left out find them. Each added image is checked by its matches with placed images, which were made
without its pose.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.sfm.attempt import ModelInputs
from massprops.sfm.convert import take_out_images, to_points, to_views
from massprops.sfm.database import drop_pairs
from massprops.sfm.guided import seen_alike
from massprops.sfm.loops import match_predicted
from massprops.sfm.mapping import continue_mapping
from massprops.sfm.match_parts import put_back, taken
from massprops.sfm.pattern_images import with_images_of_pattern

BORNE_OUT = 0.5
"""Share of an image's verified matches with placed ones that its place must agree with."""

REACH = 0.0125
"""Distance from its place at which a match agrees, in longer sides of the image: as far as matches are looked for
once poses are right."""

MATCHED = 0.25
"""Share of the points before an image, of that of the images placed before, that it must see once they are looked for. Set
on one scene, a printed cloth: right images had 0.3 of the usual share and more, those that were up to 15 degrees off 0.22
and less."""

MOST_ROUNDS = 8


def add_left_out_images(
    model: pycolmap.Reconstruction, given: ModelInputs, rounds: int = MOST_ROUNDS
) -> pycolmap.Reconstruction:
    """Adds the images that the points of the model place, in rounds; returns the model.

    Args:
        rounds: at most; none of them goes on after one that adds nothing.
    """
    attempt = given.found
    for turn in range(rounds):
        known = set(model.reg_image_ids())
        if attempt.repeats:
            grown = with_images_of_pattern(model, given)
        else:
            grown = continue_mapping(model, attempt.database, given.frames, given.work / f"more{turn}", attempt.mapping)
            take_out_contradicted(grown, attempt.database, known)
        added = set(grown.reg_image_ids()) - known
        if not added:
            break
        fresh = {grown.image(i).name for i in added}
        before = {i: taken(attempt.database, pairs) for i, pairs in _pairs_of(attempt.database, added).items()}
        try:
            grown = match_predicted(grown, given, given.work / f"more{turn}", fresh)
        except NotPossible:
            break
        take_out_unmatched(grown, fresh)
        gone = added - set(grown.reg_image_ids())
        for image_id, pairs in _pairs_of(attempt.database, gone).items():
            # made where the image was wrongly placed, they would place it there again
            drop_pairs(attempt.database, map(pycolmap.pair_id_to_image_pair, pairs))
            put_back(attempt.database, before[image_id])
        if grown.num_reg_images() <= model.num_reg_images():
            break
        model = grown
    return model


def _pairs_of(database: Path, image_ids: set[int]) -> dict[int, list[int]]:
    """The matched pairs of each of the images."""
    with pycolmap.Database.open(database) as db:
        pairs = [int(p) for p in db.read_all_matches()[0]] if image_ids else []
    return {i: [p for p in pairs if i in pycolmap.pair_id_to_image_pair(p)] for i in sorted(image_ids)}


def take_out_unmatched(model: pycolmap.Reconstruction, fresh: set[str]) -> None:
    """Removes those of the images `fresh`, in place, that see almost none of the points that their pose should show."""
    views, ids = to_views(model)
    points = to_points(model, ids)
    share = {}
    for i, name in enumerate(views.names):
        index, _ = seen_alike(views, points, i)
        share[name] = float(np.isin(index, points.obs_point[points.obs_view == i]).mean()) if len(index) else 0.0
    usual = float(np.median([s for name, s in share.items() if name not in fresh]))
    lost = [i for i, n in zip(ids, views.names, strict=True) if n in fresh and share[n] < MATCHED * usual]
    take_out_images(model, lost)


def take_out_contradicted(model: pycolmap.Reconstruction, database: Path, known: set[int]) -> None:
    """Removes images, in place, whose matches with the images `known` contradict their pose."""
    agreeing = agreeing_matches(model, database, known)
    take_out_images(model, [i for i, count in agreeing.items() if _contradicted(*count)])


def _contradicted(agree: int, all_of: int) -> bool:
    return agree < BORNE_OUT * all_of


def take_out_unsupported(model: pycolmap.Reconstruction, database: Path, known: set[int]) -> None:
    """Removes images that a motion placed after the images `known`, in place, where matches contradict it, and those that hang on them.

    Each image that its matches bear out judges the next ones. Where nothing is contradicted, images without any matches stay.
    """
    judges, before = set(known), set[int]()
    while judges != before:
        before = set(judges)
        agreeing = agreeing_matches(model, database, judges)
        judges |= {i for i, (agree, all_of) in agreeing.items() if all_of and not _contradicted(agree, all_of)}
    if any(_contradicted(*count) for count in agreeing.values()):
        take_out_images(model, set(model.reg_image_ids()) - judges)


def agreeing_matches(model: pycolmap.Reconstruction, database: Path, known: set[int]) -> dict[int, tuple[int, int]]:
    """For each placed image that is not `known`, how many of its verified matches with points of known ones fall where its
    place says, and how many there are.

    Points and not epipolar lines: one cell further on along a line, a pattern agrees with every line.
    """
    from massprops.sfm.points import projected

    views, ids = to_views(model)
    row = {image_id: i for i, image_id in enumerate(ids)}
    count = {i: np.zeros(2, int) for i in ids if i not in known}
    with pycolmap.Database.open(database) as db:
        for pair_id, geometry in zip(*db.read_two_view_geometries(), strict=True):
            pair = pycolmap.pair_id_to_image_pair(pair_id)
            matches = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
            if not len(matches) or any(i not in row for i in pair) or (pair[0] in known) == (pair[1] in known):
                continue
            new = int(pair[0] in known)
            xyz, there = _points(model, pair[1 - new], matches[:, 1 - new])
            place = np.asarray(db.read_keypoints(pair[new]), float)[matches[there, new], :2] - 0.5
            v = np.full(len(place), row[pair[new]])
            with np.errstate(all="ignore"):
                away = np.linalg.norm(projected(views, v, xyz) - place, axis=1)
            near = away < REACH * float(views.size[row[pair[new]]].max())
            count[pair[new]] += [int(near.sum()), len(near)]
    return {i: (int(c[0]), int(c[1])) for i, c in count.items()}


def _points(model: pycolmap.Reconstruction, image_id: int, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 3) of those features of an image that have one, and (k,) bool which do."""
    features = model.image(image_id).points2D
    there = np.array([features[i].has_point3D() for i in index.tolist()], bool)
    xyz = [model.point3D(features[i].point3D_id).xyz for i in index[there].tolist()]
    return np.array(xyz, float).reshape(-1, 3), there
