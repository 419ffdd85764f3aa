"""Pairs of images whose agreement chance explains, told by the number of such pairs that chance would make.

Matches that are loosely chosen are mostly wrong, and the best of thousands of epipolar geometries agrees with a dozen of
them. A pair is believed where, of all pairs tried, less than one would agree so well if its matches were drawn at random
(a contrario: Moisan and Stival 2004, "A probabilistic criterion to detect rigid point matches between two images and
estimate the fundamental matrix"). Random matches are those between the features that did match, so that features which
crowd on a small object do not count as agreement.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path

import numpy as np
import pycolmap
from scipy.special import gammaln

from massprops.geometry.epipolar import sampson

PARAMETERS = 7
"""Matches that fix a fundamental matrix."""

DISTANCES = (0.5, 1.0, 2.0, 4.0)
"""Distances from the epipolar line at which agreement is counted [px], up to that which made the pair."""

SHUFFLES = 20
"""Random matches drawn for each match."""


def expected_by_chance(distance: np.ndarray, random: np.ndarray) -> float:
    """Natural logarithm of the number of pairs like this that chance is expected to make, one pair having been tried.

    Args:
        distance: (n,) of the matches from the epipolar lines of the geometry that agrees best with them [px].
        random: (m,) the same of random matches.
    """
    n, least = len(distance), np.inf
    for reach in DISTANCES:
        k = int(np.count_nonzero(distance < reach))
        if k <= PARAMETERS:
            continue
        share = max(int(np.count_nonzero(random < reach)), 1) / max(len(random), 1)
        tests = np.log(len(DISTANCES) * (n - PARAMETERS)) + _choices(n, k) + _choices(k, PARAMETERS)
        least = min(least, tests + (k - PARAMETERS) * np.log(share))
    return float(least)


def _choices(n: int, k: int) -> float:
    return float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))


def drop_chance(database: Path, seed: int) -> int:
    """Takes the two-view geometries out of a database that chance explains; the matches stay.

    Args:
        seed: of the random matches.

    Returns:
        how many were taken out.
    """
    rng = np.random.default_rng([seed, 41])
    with pycolmap.Database.open(database) as db:
        pair_ids, geometries = db.read_two_view_geometries()
        pairs = [pycolmap.pair_id_to_image_pair(p) for p in pair_ids]
        places = {i: np.asarray(db.read_keypoints(i), float)[:, :2] for pair in pairs for i in pair}
        tried = max(int(db.num_matched_image_pairs()), 1)
        gone = 0
        for (a, b), geometry in zip(pairs, geometries, strict=True):
            matches = np.asarray(db.read_matches(a, b), int).reshape(-1, 2)
            if len(geometry.inlier_matches) and _expected(matches, geometry, places[a], places[b], rng) > -np.log(
                tried
            ):
                db.delete_two_view_geometry(a, b)
                gone += 1
    return gone


def _expected(
    matches: np.ndarray,
    geometry: pycolmap.TwoViewGeometry,
    first: np.ndarray,
    second: np.ndarray,
    rng: np.random.Generator,
) -> float:
    n = len(matches)
    if geometry.F is None or not np.any(geometry.F) or n <= PARAMETERS:
        return -np.inf
    F = np.asarray(geometry.F)
    x, y = (np.column_stack([p[matches[:, k]], np.ones(n)]) for k, p in enumerate((first, second)))
    turns = [np.roll(np.arange(n), s) for s in rng.integers(1, n, SHUFFLES)]
    random = np.concatenate([sampson(F, x, y[turn]) for turn in turns])
    return expected_by_chance(sampson(F, x, y), random)
