"""Matches of features that are the only ones of their look.

On a patterned cloth, on solar cells, on tiles every feature has twins, and the nearest in the other image is as likely
a twin as itself; the ratio test (Lowe 2004, section 7.1) passes those that noise has set apart. Here a feature must
also be unlike every other place of its own image: what repeats is seen to repeat in one image already. What is left is
little, but mostly right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.geometry import vectors

APART = 8.0
"""Features nearer than this to each other show the same place [px]."""

RATIO = 0.8
"""Of the angle between matching descriptors to that of the next best, of all features or of those within a gate."""

OWN_RATIO = 0.7
"""Of the angle between matching descriptors to that between either and the likest in its own image."""

LEAST_OWN = 0.3
"""Angle to the likest in its own image below which a feature is one of a repeating pattern [rad]; the same place seen
15 degrees further on differs by 0.2 to 0.3."""

WIDEST = 0.7
"""Angle between descriptors above which nothing matches, as in COLMAP [rad]."""


@dataclass(frozen=True)
class Described:
    """Features of one image, ready to be matched: unit descriptors (k, 128) of all of them, and of those that repeat
    nowhere their places `index` (d,) among all and their angle `own` (k,) to the likest of their image [rad]."""

    unit: np.ndarray
    own: np.ndarray
    index: np.ndarray


def describe(keypoints: np.ndarray, descriptors: np.ndarray) -> Described:
    """Finds what repeats within an image.

    Args:
        keypoints: (k, 2 or more) x, y ... [px].
        descriptors: (k, 128) uint8.
    """
    rows = unit(descriptors)
    return _described(rows, _likeness(rows, keypoints[:, :2], np.zeros(0, np.float32)))


def _described(rows: np.ndarray, cosine: np.ndarray) -> Described:
    """Rows (k, 128) of which the largest cosine (k,) to any other is known."""
    nearest_angle = angles(cosine)
    return Described(rows, nearest_angle, np.flatnonzero(nearest_angle > LEAST_OWN))


def _likeness(rows: np.ndarray, places: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(k,) largest cosine of each row (k, 128) to any elsewhere; places (k, 2) [px]; known (a,) of the first among themselves."""
    from scipy.spatial import cKDTree

    a = len(known)
    cosine = rows[a:] @ rows.T
    first, second = cKDTree(places).query_pairs(APART, output_type="ndarray").T if len(rows) else np.zeros((2, 0), int)
    for i, j in ((first, second), (second, first)):
        fresh = i >= a
        cosine[i[fresh] - a, j[fresh]] = 0.0
    fresh = np.arange(a, len(rows))
    cosine[fresh - a, fresh] = 0.0
    return np.concatenate([np.maximum(known, cosine[:, :a].max(0, initial=0.0)), cosine.max(1, initial=0.0)])


def largest(keypoints: np.ndarray, descriptors: np.ndarray, enough: int) -> tuple[np.ndarray, Described]:
    """Places (d,) of the features of largest scales among which at least `enough` repeat nowhere, all where there are fewer of these,
    and these features described.

    What a feature is held against grows with their number, and so does the cost of a pair with its square: large photographs
    show many times what a pair needs.

    Args:
        keypoints: (k, 3 or more) x, y, scale ... [px].
        descriptors: (k, 128) uint8.
    """
    order = np.argsort(-keypoints[:, 2], kind="stable")
    rows, places = unit(descriptors[order]), keypoints[order, :2]
    count, cosine = min(enough, len(order)), np.zeros(0, np.float32)
    while True:
        cosine = _likeness(rows[:count], places[:count], cosine)
        unique = int(np.count_nonzero(angles(cosine) > LEAST_OWN))
        if unique >= enough or count == len(order):
            break
        count = min(2 * count, count * enough // max(unique, 1) + 1, len(order))
    back = np.argsort(order[:count])
    return order[back], _described(rows[back], cosine[back])


def unit(descriptors: np.ndarray) -> np.ndarray:
    """(k, 128) float32 of length one."""
    return vectors.unit(descriptors.astype(np.float32))


def repeating(images: list[Described]) -> float:
    """Share of the features of all images that have a twin in their own image."""
    total = sum(len(d.own) for d in images)
    return 1.0 - sum(len(d.index) for d in images) / max(total, 1)


def match_distinct(a: Described, b: Described) -> np.ndarray:
    """(m, 2) uint32: places of features of two images that are each other's nearest, and unlike all else in both."""
    if not len(a.index) or not len(b.index):
        return np.zeros((0, 2), np.uint32)
    first, second = a.unit[a.index], b.unit[b.index]
    cosine = first @ second.T
    best = cosine.argmax(1)
    row = np.arange(len(best))
    angle = angles(cosine[row, best])
    near = (angle < OWN_RATIO * np.minimum(a.own[a.index], b.own[b.index[best]])) & (angle < WIDEST)
    # the largest of each column costs a thirtieth of where it is; few are left to be held against the features that repeat
    top = cosine.max(0)
    row = row[(cosine[row, best] == top[best]) & near]
    if np.count_nonzero(cosine == top) > len(top):
        # of equal ones the first counts
        row = row[cosine.T[best[row]].argmax(1) == row]
    best = best[row]
    to_b, to_a = first[row] @ b.unit.T, second[best] @ a.unit.T
    ok = (to_b.argmax(1) == b.index[best]) & (to_a.argmax(1) == a.index[row])
    ok &= angle[row] < RATIO * np.minimum(_second(to_b), _second(to_a))
    return np.column_stack([a.index[row[ok]], b.index[best[ok]]]).astype(np.uint32)


def _second(cosine: np.ndarray) -> np.ndarray:
    """Angle to the second nearest of each row."""
    if cosine.shape[1] < 2:
        return np.full(len(cosine), np.pi / 2)
    return angles(np.partition(cosine, -2, axis=1)[:, -2])


def angles(cosine: np.ndarray) -> np.ndarray:
    """Angles [rad] of cosines of any shape."""
    return np.arccos(np.clip(cosine, -1.0, 1.0))
