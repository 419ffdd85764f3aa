"""Pairs of images that match well, but not where the model has them.

Every pair's matches agree on one geometry, found without the model. In a model that is right nearly all of them bear it
out. Where many do not, what they show moved between the photographs, or two sides of the object look alike, and the
model is a compromise between things that cannot all be true.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pycolmap

from massprops.sfm.convert import to_views
from massprops.sfm.guided import off_line

LEAST = 30
"""Verified matches from which on a pair is no chance."""

OFF = 0.004
"""Distance from the model's epipolar line from which on a match contradicts it, in longer sides of the image: 5 px of
1280."""

BORNE_OUT = 0.5
"""Share of a pair's matches from which on the model bears it out."""

MANY = 0.05
"""Share of the matches of all such pairs in contradicted ones from which on it is said: 0.10 of a parcel that was turned
between photographs while the room stayed, none of a tumbling spacecraft."""


@dataclass(frozen=True)
class Contradictions:
    """share: of the matches, those in pairs of which the model bears out less than half; pairs: names of such pairs, those
    with most matches first; shares: of the matches, those in each of these pairs."""

    share: float
    pairs: tuple[tuple[str, str], ...]
    shares: tuple[float, ...] = ()

    def said(self, source: dict[str, str]) -> list[str]:
        """The warning, if any; source gives the user's name of each image."""
        if self.share < MANY:
            return []
        a, b = (source.get(n) or n for n in self.pairs[0])
        return [
            f"{100 * self.share:.0f} % of the matches are in pairs of images that contradict the rest, such as {a} and {b}: "
            "the object was moved between photographs and its surroundings were not, or two of its sides look alike; leave "
            "one of such images out, or give silhouettes with --masks"
        ]


class PairAgreement(NamedTuple):
    """Verified matches of two images (COLMAP's numbers), and the share of them that lies where a model says."""

    first: int
    second: int
    matches: int
    share: float


def contradictions(model: pycolmap.Reconstruction, database: Path) -> Contradictions:
    """What the verified matches of a database say against a model of its images."""
    pairs = agreement_of_pairs(model, database, LEAST)
    total = max(sum(p.matches for p in pairs), 1)
    name = {p: model.image(p).name for p in model.reg_image_ids()}
    against = [(p.matches, name[p.first], name[p.second]) for p in pairs if p.share < BORNE_OUT]
    against.sort(key=lambda c: (-c[0], c[1:]))
    share = sum(n for n, _, _ in against) / total
    return Contradictions(float(share), tuple((a, b) for _, a, b in against), tuple(n / total for n, _, _ in against))


def agreement_of_pairs(model: pycolmap.Reconstruction, database: Path, least: int) -> list[PairAgreement]:
    """How far the pairs of a model's images with enough matches bear it out."""
    import cv2

    views, ids = to_views(model)
    row = {image_id: i for i, image_id in enumerate(ids)}
    out = []
    with pycolmap.Database.open(database) as db:
        rays: dict[int, np.ndarray] = {}
        for image_id, i in row.items():
            uv = np.asarray(db.read_keypoints(image_id), float)[:, :2] - 0.5
            flat = cv2.undistortPoints(uv[:, None], views.K[i], views.distortion[i])[:, 0] if len(uv) else uv
            rays[image_id] = np.column_stack([flat, np.ones(len(flat))])
        for pair_id, geometry in zip(*db.read_two_view_geometries(), strict=True):
            a, b = pycolmap.pair_id_to_image_pair(pair_id)
            matches = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
            if a not in row or b not in row or len(matches) < least:
                continue
            away = off_line(views, (row[a], row[b]), rays[a][matches[:, 0]], rays[b][matches[:, 1]])
            near = float(np.mean(away < OFF * float(views.size[row[b]].max())))
            out.append(PairAgreement(a, b, len(matches), near))
    return out
