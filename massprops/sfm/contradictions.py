"""Pairs of images that match well, but not where the model has them.

Every pair's matches agree on one geometry, found without the model. In a model that is right nearly all of them bear it
out. Where many do not, what they show moved between the photographs, or two sides of the object look alike, and the
model is a compromise between things that cannot all be true. Or a pattern about the object repeats: what its own matches
say is known once it is told from its surroundings (`massprops.sfm.verified_matches`).
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
from massprops.sfm.verified_matches import BORNE_OUT, LEAST, MANY, VerifiedMatches

OFF = 0.004
"""Distance from the model's epipolar line from which on a match contradicts it, in longer sides of the image: 5 px of
1280."""


@dataclass(frozen=True)
class Contradictions:
    """share: of the matches, those in pairs of which the model bears out less than half; pairs: names of such pairs, those
    with most matches first; shares: of the matches, those in each of these pairs; matches: of all pairs, where any is
    contradicted."""

    share: float
    pairs: tuple[tuple[str, str], ...]
    shares: tuple[float, ...] = ()
    matches: VerifiedMatches | None = None

    def said(self, source: dict[str, str]) -> list[str]:
        """The warning, if any; source gives the user's name of each image."""
        if self.share < MANY:
            return []
        a, b = (source.get(n) or n for n in self.pairs[0])
        return [
            f"{100 * self.share:.0f} % of the matches are in pairs of images that contradict the rest, such as {a} and {b}: "
            "the object was moved between photographs and its surroundings were not, two of its sides look alike, or a pattern "
            "about it repeats; leave one of such images out, or give silhouettes with --masks"
        ]


class PairAgreement(NamedTuple):
    """Verified matches of two images (COLMAP's numbers): their places (m, 4) in both [px], and which (m,) lie where a model
    says."""

    first: int
    second: int
    places: np.ndarray
    near: np.ndarray

    @property
    def matches(self) -> int:
        return len(self.near)

    @property
    def share(self) -> float:
        """Of the matches, those that lie where the model says."""
        return float(self.near.mean())


def contradictions(model: pycolmap.Reconstruction, database: Path) -> Contradictions:
    """What the verified matches of a database say against a model of its images."""
    pairs = agreement_of_pairs(model, database, LEAST)
    total = max(sum(p.matches for p in pairs), 1)
    name = {p: model.image(p).name for p in model.reg_image_ids()}
    against = [(p.matches, name[p.first], name[p.second]) for p in pairs if p.share < BORNE_OUT]
    against.sort(key=lambda c: (-c[0], c[1:]))
    share = sum(n for n, _, _ in against) / total
    return Contradictions(
        float(share),
        tuple((a, b) for _, a, b in against),
        tuple(n / total for n, _, _ in against),
        _kept(pairs, name) if against else None,
    )


def _kept(pairs: list[PairAgreement], name: dict[int, str]) -> VerifiedMatches:
    """Args: name: of each image, by its number."""
    return VerifiedMatches(
        tuple((name[p.first], name[p.second]) for p in pairs),
        np.repeat(np.arange(len(pairs)), [p.matches for p in pairs]),
        np.concatenate([p.places for p in pairs]).astype(np.float32),
        np.concatenate([p.near for p in pairs]),
    )


def agreement_of_pairs(model: pycolmap.Reconstruction, database: Path, least: int) -> list[PairAgreement]:
    """How far the pairs of a model's images with enough matches bear it out."""
    import cv2

    views, ids = to_views(model)
    row = {image_id: i for i, image_id in enumerate(ids)}
    out = []
    with pycolmap.Database.open(database) as db:
        rays: dict[int, np.ndarray] = {}
        at: dict[int, np.ndarray] = {}
        for image_id, i in row.items():
            at[image_id] = uv = np.asarray(db.read_keypoints(image_id), float)[:, :2] - 0.5
            flat = cv2.undistortPoints(uv[:, None], views.K[i], views.distortion[i])[:, 0] if len(uv) else uv
            rays[image_id] = np.column_stack([flat, np.ones(len(flat))])
        for pair_id, geometry in zip(*db.read_two_view_geometries(), strict=True):
            a, b = pycolmap.pair_id_to_image_pair(pair_id)
            matches = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
            if a not in row or b not in row or len(matches) < least:
                continue
            away = off_line(views, (row[a], row[b]), rays[a][matches[:, 0]], rays[b][matches[:, 1]])
            places = np.hstack([at[a][matches[:, 0]], at[b][matches[:, 1]]])
            out.append(PairAgreement(a, b, places, away < OFF * float(views.size[row[b]].max())))
    return out
