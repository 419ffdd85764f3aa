"""Photographs whose matches contradict each other: what of them is true of one rigid object.

Two causes are known. The object was moved by hand while its room stayed: then its own features are used alone. Or its sides look
alike: a false pair of images shares a print and no more, a true one all that both see. So pairs with few matches are given up,
the fewest first, until nothing that is left contradicts the model. Both may be needed: the parcel on which this was set was turned
by hand, and each of its sides is printed as the opposite one.
"""

from __future__ import annotations

import shutil
import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap

from massprops.core.progress import Progress
from massprops.errors import NotPossible
from massprops.geometry.vectors import turn_deg
from massprops.sfm.alike_sides import holding, wrongly_joined
from massprops.sfm.attempt import Attempt, SfmOptions, Way, attempt, mapped
from massprops.sfm.contradictions import Contradictions, contradictions
from massprops.sfm.convert import to_views
from massprops.sfm.database import drop_pairs
from massprops.sfm.footage import FootageRecord
from massprops.sfm.own_features import own_features
from massprops.sfm.verified_matches import LEAST, MANY

STEPS = (LEAST, 45, 60, 90, 120)
"""Matches from which on a pair is believed, one after the other. Of the parcel false pairs share 40 and less, and neighbours in a round
50 and more."""

ROUNDS = 4
"""Times that what holds images on a wrong side is given up."""

PLACEMENT, ACROSS = 6, 0.95
"""Images of a placement that is solved by itself, and the share of the contradicted matches that one moment parts where it was turned."""

SAME_DEG = 3.0
"""Angle within which an image stays where it was. Of a tin that a hand turned (Blender) the object's own places leave 4 of 30 there."""

HALF = 0.5
"""Share of the images that must stay placed; and that must have stayed where they were for nothing to have changed."""


def without_contradictions(
    found: Attempt, footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress
) -> Attempt:
    """The attempt as it is where its matches bear out its model, else the first one that is free of contradictions; as it is, too,
    where none is.

    Args:
        work: an empty folder.
    """
    against = _against(found)
    if against.share < MANY or _turned_once(against, footage):
        return found
    by_object = _by_object(found, footage, work, options, progress)
    for way, start in (("own", by_object), ("all", found)):
        settled = start and _by_strong_pairs(start, footage, work / f"{way}-strong", progress)
        if settled and not _unchanged(found, settled, against):
            return settled
    if by_object and _against(by_object).share < MANY and not _unchanged(found, by_object, against):
        return by_object
    return found


def _unchanged(before: Attempt, after: Attempt, against: Contradictions) -> bool:
    """Whether images stay where they were, all that are contradicted among them: then what contradicts was not removed, only hidden. So
    it is of a plain bottle that a hand turned on a patterned cloth, for whose features the cloth's are taken.

    Args:
        against: what contradicts the attempt before.
    """
    first, second = (dict(zip(v.names, v.R, strict=True)) for v, _ in (to_views(a.models[0]) for a in (before, after)))
    doubted = {name for pair in against.pairs for name in pair}
    common = sorted(first.keys() & second.keys())
    if doubted - second.keys() or not common:
        return False
    turns = [first[name].T @ second[name] for name in common]
    return max(float(np.mean([turn_deg(a, b) < SAME_DEG for b in turns])) for a in turns) > HALF


def _turned_once(against: Contradictions, footage: FootageRecord) -> bool:
    """Whether one moment, in the order of the images, parts the two of each contradicted pair: the object was turned over in its room,
    which places all images, and either placement is solved by itself."""
    order = {f.name: i for i, f in enumerate(footage.frames)}
    ends = np.array([sorted((order[a], order[b])) for a, b in against.pairs])
    return any(
        np.dot((ends[:, 0] < k) & (k <= ends[:, 1]), against.shares) >= ACROSS * against.share
        for k in range(PLACEMENT, len(order) - PLACEMENT + 1)
    )


def _by_object(
    found: Attempt, footage: FootageRecord, work: Path, options: SfmOptions, progress: Progress
) -> Attempt | None:
    """What the object's own features place, where pairs show that it was moved."""
    of_object = {} if found.mapping.masked else own_features(found.database, found.mapping)
    if not of_object:
        return None
    features = {
        name: (places[of_object[name]], descriptors[of_object[name]])
        for name, (places, descriptors) in found.features.items()
    }
    way: Way = "faint" if found.special else "usual"
    try:
        again = attempt(footage, work / "own", options, False, way, progress, features)
    except NotPossible:
        return None
    if again.registered < HALF * found.registered:
        return None
    line = "the object was moved between photographs while its surroundings stayed: only its own features were used"
    return replace(again, moved=True, warnings=[*again.warnings, line])


def _by_strong_pairs(found: Attempt, footage: FootageRecord, work: Path, progress: Progress) -> Attempt | None:
    """What pairs with many matches place, as few given up as leave no contradiction; None where too few images would be left.

    What holds images on a side that only looks like theirs is given up as well. Images that only weak pairs would place are left out:
    of the parcel they were laid by a logo that every side bears.
    """
    if not (_against(found).pairs or wrongly_joined(found.models[0], found.database)):
        return found
    work.mkdir(parents=True)
    database = work / "database.db"
    shutil.copy(found.database, database)
    maps = Maps(found, footage, progress)
    core = _core(maps, database, work)
    if core is None or core.registered < HALF * found.registered:
        return None
    line = (
        f"sides of the object look alike: pairs of images with fewer than {core.matches_required} matches were given up, as they contradict "
        "the rest"
    )
    return replace(core, warnings=[*found.warnings, line])


def _core(maps: Maps, database: Path, work: Path) -> Attempt | None:
    """The images that strong pairs place without a contradiction, none of them on a side that only looks like its own.

    Args:
        database: loses the pairs that held images on such a side.
    """
    for turn in range(ROUNDS):
        core = maps.strong(database, work / f"strong{turn}")
        if core is None or not (branch := wrongly_joined(core.models[0], database)):
            return core
        drop_pairs(database, holding(core.models[0], database, branch))
    return None


@dataclass(frozen=True)
class Maps:
    """Maps of an attempt's images by part of its matches."""

    found: Attempt
    footage: FootageRecord
    progress: Progress

    def all_of(self, database: Path, work: Path) -> Attempt | None:
        """By all that a database holds; None where no pair begins a model."""
        work.mkdir()
        total, mapping = len(self.found.features), self.found.mapping
        try:
            models = mapped(database, self.footage, work / "models", mapping, total, self.progress)
        except NotPossible:
            return None
        return replace(self.found, database=database, models=models)

    def strong(self, database: Path, work: Path) -> Attempt | None:
        """By as many of a database's strongest pairs as contradict nothing; None where too few images are left."""
        work.mkdir()
        strong = work / "database.db"
        shutil.copy(database, strong)
        for least in STEPS:
            drop_pairs(strong, _weak(strong, least))
            kept = self.all_of(strong, work / str(least))
            if kept is None or kept.registered < HALF * self.found.registered:
                return None
            if not _against(kept).pairs:
                return replace(kept, matches_required=least)
        return None


def _against(found: Attempt) -> Contradictions:
    return contradictions(found.models[0], found.database)


def _weak(database: Path, least: int) -> list[tuple[int, int]]:
    """Pairs of images with fewer verified matches."""
    with pycolmap.Database.open(database) as db:
        geometries = zip(*db.read_two_view_geometries(), strict=True)
        return [pycolmap.pair_id_to_image_pair(p) for p, g in geometries if len(g.inlier_matches) < least]
