"""Covariance of a least-squares fit whose errors are alike within clusters, in one way or several.

The sandwich with clusters (Huber 1967; Liang and Zeger 1986, eq. 5), in several ways at once (Cameron, Gelbach and Miller
2011, eq. 2.10), each cluster judged without itself (the jackknife: Bell and McCaffrey 2002, CR3).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

LEAST_LEFT = 0.02
"""Share of the information on a combination of numbers that counts as left where a cluster holds all of it."""


@dataclass(frozen=True)
class Scores:
    """What o observations say of f numbers once all others are eliminated.

    Attributes:
        score: (o, f) weighed derivatives times residuals; slope: (o, 2, f) derivatives times the root of the weight.
        root: (f, f) with root^T root the inverse of the whole information.
    """

    score: np.ndarray
    slope: np.ndarray
    root: np.ndarray


def alike_in_any(seen: Scores, labels: tuple[np.ndarray, ...]) -> np.ndarray:
    """(f, f) middle of the sandwich for errors alike in any of several ways: sums over clusters (o,) of each, less those of
    pairs, and so on. It need not be positive."""
    total = np.zeros((seen.score.shape[1],) * 2)
    for count in range(1, len(labels) + 1):
        for some in combinations(labels, count):
            total -= (-1) ** count * _summed(seen, np.unique(np.stack(some), axis=1, return_inverse=True)[1].ravel())
    return total


def _summed(seen: Scores, label: np.ndarray) -> np.ndarray:
    """(f, f) sum over clusters (o,) of the squared sums of their scores.

    The fit bends to a cluster that decides it, such as the first or the last block of a record, and leaves it small
    residuals. So a score counts as it would without its cluster in the fit.
    """
    total = np.zeros((seen.score.shape[1],) * 2)
    for one in np.unique(label):
        own = label == one
        slope = seen.slope[own].reshape(-1, total.shape[0]) @ seen.root.T
        share, ways = np.linalg.eigh(slope.T @ slope)
        # in units of the whole information: what is left without the cluster
        left = 1.0 / np.clip(1.0 - share, LEAST_LEFT, 1.0)
        unit = seen.root @ seen.score[own].sum(axis=0)
        moved = np.linalg.solve(seen.root, ways @ (left * (ways.T @ unit)))
        total += np.outer(moved, moved)
    count = len(np.unique(label))
    return total * (count - 1) / count
