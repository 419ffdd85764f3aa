"""A flying body's film mapped from several starts, until one convinces; else the one that explains most is kept.

Crinkled foil and dark sides leave few matches that are right, and where a mapper begins decides what it makes of them. Of one body in
foil (Blender) a first start placed 30 of 88 images, a second one 82, all of them right; of another a first start came to a motion that was
off by 1.4 degrees at the ends of the film, a second one by 6.6, with as many observations that fitted less well.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.geometry.vectors import turns_apart
from massprops.sfm.along_motion import CONVINCES, CUTS, GATES
from massprops.sfm.attempt import ENOUGH, ModelInputs
from massprops.sfm.contradictions import contradictions
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.footage import FootageRecord
from massprops.sfm.free_adjustment import cauchy_cost
from massprops.sfm.grown_film import is_film, strays_from_motion
from massprops.sfm.verified_matches import MANY

STARTS = 3
"""Times that a film is mapped at most."""

ALIKE_DEG = 1.0
"""Turn of an image up to which two starts have placed it alike. Of a body in foil whose motion gained 2.8 two starts differ by .7 degrees;
where one is wrong, by 2 to 26 in some images."""

UNSURE = (
    "the film was mapped several times, and no two results agree, nor does one convince: its images may be placed wrongly; film it sharper, "
    "slower, better lit or with less compression"
)


@dataclass(frozen=True)
class MappedFootage:
    """A footage's images placed, before the last adjustment.

    Attributes:
        model: of the images.
        given: what it was found by, and how it is to be adjusted.
        first: the database whose matches were made without a model.
        warnings: one line each.
        unsure: several starts came to different results, of which none convinces.
    """

    model: pycolmap.Reconstruction
    given: ModelInputs
    first: Path
    warnings: list[str]
    unsure: bool = False

    @property
    def explained(self) -> float:
        """What is known of where the observations lie, beyond that each lies within the last gate, by the model [nat]."""
        views, ids = to_views(self.model)
        count = self.model.compute_num_observations()
        if not count:
            return 0.0
        square = 2.0 * cauchy_cost(views, to_points(self.model, ids), CUTS[-1]) / count
        reach = GATES[-1].line * max(self.given.footage.cameras[0].size)
        return float(0.5 * count * np.log(reach**2 / max(square, 1e-12)))

    @property
    def convinces(self) -> bool:
        """Whether nearly all images are placed that show something, by a motion that they follow, or near one, by matches that do not
        contradict each other. Of a CubeSat with like sides (Blender) none did, though 40 of 87 images were turned by up to 90 degrees."""
        following = self.given.options.refine.following
        if self.model.num_reg_images() < ENOUGH * len(self.given.images_with_features):
            return False
        if following is not None:
            return following.gain < CONVINCES
        if strays_from_motion(self.model, self.given.footage):
            return False
        return contradictions(self.model, self.given.found.database).share < MANY

    def doubted(self) -> MappedFootage:
        """The same as one result of several."""
        return replace(self, warnings=[*self.warnings, UNSURE], unsure=True)

    def agrees(self, other: MappedFootage) -> bool:
        """Whether nearly all images that show something are turned alike by both."""
        ours, theirs = to_views(self.model)[0], to_views(other.model)[0]
        row = {name: k for k, name in enumerate(theirs.names)}
        common = [(k, row[name]) for k, name in enumerate(ours.names) if name in row]
        if not common:
            return False
        i, j = np.transpose(common)
        off = turns_apart(ours.R[i], theirs.R[j])
        return bool(np.count_nonzero(off < np.deg2rad(ALIKE_DEG)) >= ENOUGH * len(self.given.images_with_features))


def best_start(begin: Callable[[int, Path], MappedFootage], footage: FootageRecord, work: Path) -> MappedFootage:
    """The footage mapped; what flies before a black sky from further starts, until one convinces or two agree.

    Where none convinces, that which explains most is taken.

    Args:
        begin: maps it by the number of a start in an empty folder.
        work: an empty folder.

    Raises:
        NotPossible: as the first start does.
    """
    flies = (
        is_film(footage)
        and footage.motion == "tumbling"
        and footage.background == "black"
        and len(footage.cameras) == 1
    )
    first = begin(0, _empty(work / "start0"))
    if not flies or first.convinces:
        return first
    found = [first]
    for number in range(1, STARTS):
        try:
            start = begin(number, _empty(work / f"start{number}"))
        except NotPossible:
            continue
        if start.convinces:
            return start
        agrees = any(start.agrees(other) for other in found)
        found.append(start)
        if agrees:
            return _explains_most(found)
    return _explains_most(found).doubted()


def _explains_most(found: list[MappedFootage]) -> MappedFootage:
    return max(found, key=lambda mapped: mapped.explained)


def _empty(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder
