"""Matches of pairs of images, and what those on the object say against a model of its images.

Where the pattern of a cloth or of tiles repeats, matches a period off agree on a geometry of their own. They say nothing of
the object: its own matches tell where its images are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

LEAST = 30
"""Verified matches from which on a pair is no chance."""

BORNE_OUT = 0.5
"""Share of a pair's matches from which on the model bears it out."""

NEAR_IN_TIME = 8
"""Images of a film that two may lie apart for those between them to say where the two are: over as many images are compared
(`massprops.sfm.attempt.SfmOptions.overlap`), and errors of so few steps do not add up to a side."""

MANY = 0.05
"""Share of the matches of all such pairs in contradicted ones from which on it is said: 0.10 of a parcel that was turned
between photographs while the room stayed, none of a tumbling spacecraft."""


@dataclass(frozen=True)
class VerifiedMatches:
    """Attributes:
    pairs: (p,) names of two images.
    pair: (m,) int, which of them a match is of.
    places: (m, 4) of a match in the two images [px], in the geometry of the stored frames.
    near: (m,) bool, whether it lies where the model has the images.
    """

    pairs: tuple[tuple[str, str], ...]
    pair: np.ndarray
    places: np.ndarray
    near: np.ndarray

    def save(self, path: Path) -> None:
        names = np.array(self.pairs, str).reshape(-1, 2)
        np.savez(path, pairs=names, pair=self.pair, places=self.places, near=self.near)

    @classmethod
    def load(cls, path: Path) -> VerifiedMatches:
        with np.load(path, allow_pickle=False) as z:
            return cls(tuple((str(a), str(b)) for a, b in z["pairs"]), z["pair"], z["places"], z["near"])

    def of(self, kept: Sequence[bool]) -> VerifiedMatches:
        """Those of the pairs (p,) kept."""
        keep = np.asarray(kept, bool)
        of_kept = keep[self.pair]
        row = np.cumsum(keep) - 1
        pairs = tuple(p for p, k in zip(self.pairs, keep, strict=True) if k)
        return VerifiedMatches(pairs, row[self.pair[of_kept]], self.places[of_kept], self.near[of_kept])

    def on(self, masks: Mapping[str, np.ndarray]) -> np.ndarray:
        """(m,) bool, which matches lie on the object in both images.

        Args:
            masks: (height, width) of an image by name, 255 on the object; images without one show none of it.
        """
        names = np.array(self.pairs, str).reshape(-1, 2)[self.pair]
        inside = np.ones(len(self.pair), bool)
        for side in (0, 1):
            for name in np.unique(names[:, side]):
                of_image = names[:, side] == name
                inside[of_image] &= _inside(masks.get(name), self.places[of_image, 2 * side : 2 * side + 2])
        return inside


def _inside(mask: np.ndarray | None, places: np.ndarray) -> np.ndarray:
    """(k,) bool of places (k, 2)."""
    if mask is None:
        return np.zeros(len(places), bool)
    column, row = np.clip(np.rint(places).astype(int), 0, np.array(mask.shape[::-1]) - 1).T
    return np.asarray(mask[row, column] == 255)


@dataclass(frozen=True)
class Film:
    """Images that follow each other.

    Attributes:
        names: of them, in time.
        turning: a camera and a room stand still, so that all that is matched turns with the object: a turntable's plate tells one step from
            the next where a plain side of the object shows nothing.
    """

    names: tuple[str, ...] = ()
    turning: bool = False


NO_FILM = Film()
"""Photographs."""


def said_against(
    matches: VerifiedMatches, inside: np.ndarray, film: Film = NO_FILM
) -> tuple[float, tuple[str, str] | None]:
    """Share of the matches that contradict where images are as far as the object is concerned, and the two images with most of
    them.

    Of the object's own matches those in pairs that the model does not bear out count. Matches of its surroundings count only
    between images that the object's own matches do not hold together.

    Args:
        matches: of the images of one placement.
        inside: (m,) bool, which of them lie on the object (`VerifiedMatches.on`).
        film: two of its images that are few steps apart are where the object's own matches from each image between them to the next have
            them, or on a turntable its plate's: what else the two share is a side that looks like another.
    """
    size = len(matches.pairs)
    all_of, near_of = _counts(matches.pair, size), _counts(matches.pair[matches.near], size)
    of_object, own_near = _counts(matches.pair[inside], size), _counts(matches.pair[inside & matches.near], size)
    told = of_object >= LEAST
    borne_out = told & (own_near >= BORNE_OUT * of_object)
    leads = borne_out | (film.turning & (all_of >= LEAST) & (near_of >= BORNE_OUT * all_of))
    against = told & ~borne_out & ~_bridged(matches.pairs, leads, film.names)
    apart = _apart(matches.pairs, leads)
    elsewhere = apart & (all_of >= LEAST) & (near_of < BORNE_OUT * all_of)
    images = len({name for pair in matches.pairs for name in pair})
    # a handful of the object's matches are no opinion of all its images
    share = np.array(
        [of_object @ against / max(of_object @ told, LEAST * images, 1), all_of @ elsewhere / max(all_of.sum(), 1)]
    )
    count = np.where(against, of_object, np.where(elsewhere, all_of, 0))
    worst = int(count.argmax()) if size and count.any() else None
    return float(share.max()), None if worst is None else matches.pairs[worst]


def _counts(pair: np.ndarray, size: int) -> np.ndarray:
    return np.bincount(pair, minlength=size)


def _bridged(pairs: tuple[tuple[str, str], ...], borne_out: np.ndarray, film: Sequence[str]) -> np.ndarray:
    """(p,) bool, which pairs are few steps of a film apart, each of which is borne out (p,) by itself."""
    at = {name: i for i, name in enumerate(film)}
    ends = np.array([sorted((at.get(a, -1), at.get(b, -1))) for a, b in pairs], int).reshape(-1, 2)
    known = (ends >= 0).all(1)
    step = np.zeros(len(film), int)
    step[ends[borne_out & known & (ends[:, 1] == ends[:, 0] + 1), 0]] = 1
    steps = np.concatenate([[0], np.cumsum(step)])
    apart = ends[:, 1] - ends[:, 0]
    return np.asarray(known & (apart <= NEAR_IN_TIME) & (steps[ends[:, 1]] - steps[ends[:, 0]] == apart))


def _apart(pairs: tuple[tuple[str, str], ...], linking: np.ndarray) -> np.ndarray:
    """(p,) bool, which pairs are of images that the linking ones (p,) do not hold together."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    names = sorted({name for pair in pairs for name in pair})
    row = {name: i for i, name in enumerate(names)}
    ends = np.array([(row[a], row[b]) for a, b in pairs], int).reshape(-1, 2)
    one, other = ends[linking].T
    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(len(names), len(names)))
    part = connected_components(graph, directed=False)[1]
    return np.asarray(part[ends[:, 0]] != part[ends[:, 1]])
