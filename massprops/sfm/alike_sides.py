"""Images that hang on the wrong one of two sides that look alike: told by what they lack.

A print that two sides share holds images on the wrong one by some dozens of matches, and nothing that is there contradicts them. But
images that look from like directions show the same side, and on the wrong one they lack nearly all that these have in common (missing
correspondences: Zach, Irschara and Bischof 2008).
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from pathlib import Path

import numpy as np
import pycolmap
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from massprops.sfm.contradictions import agreement_of_pairs
from massprops.sfm.convert import to_views
from massprops.sfm.verified_matches import BORNE_OUT

LIKE_DEG = 25.0
"""Angle between two directions of view below which two images show the same side."""

FEW = 0.15
"""Images that share less than this part of what is usual with those from like directions show another side. Of a parcel printed alike on
opposite sides (23 phone photographs): 0.08 on the wrong side, 0.25 and more on the right one."""


def wrongly_joined(model: pycolmap.Reconstruction, database: Path) -> set[int]:
    """Images (COLMAP's numbers) of a model that hang on its larger part by what two sides share."""
    return lacking(*_counts(model, database))


def lacking(ids: list[int], count: np.ndarray, like: np.ndarray) -> set[int]:
    """Images that share next to nothing with others from like directions.

    The strongest matches hold all images together as a tree. Where one of its branches looks from like directions as the rest, and
    shares next to nothing there, it shows another side. The worst branch goes first.

    Args:
        ids: numbers of the images.
        count: (n, n) matches of each two.
        like: (n, n) bool, whether they look from like directions.
    """
    lost: set[int] = set()
    while branch := _worst_branch(ids, count, like, lost):
        lost |= branch
    return lost


def holding(model: pycolmap.Reconstruction, database: Path, branch: set[int]) -> list[tuple[int, int]]:
    """The pairs of a branch's images and others (COLMAP's numbers) whose matches hold it where it is."""
    pairs = agreement_of_pairs(model, database, 1)
    return [(p.first, p.second) for p in pairs if (p.first in branch) != (p.second in branch) and p.share >= BORNE_OUT]


def _counts(model: pycolmap.Reconstruction, database: Path) -> tuple[list[int], np.ndarray, np.ndarray]:
    """The placed images' numbers; verified matches (n, n) of each two; whether they look from like directions (n, n) bool."""
    views, ids = to_views(model)
    row = {image_id: i for i, image_id in enumerate(ids)}
    count = np.zeros((len(ids), len(ids)))
    with pycolmap.Database.open(database) as db:
        for pair_id, geometry in zip(*db.read_two_view_geometries(), strict=True):
            a, b = pycolmap.pair_id_to_image_pair(pair_id)
            if a in row and b in row:
                count[row[a], row[b]] = count[row[b], row[a]] = len(geometry.inlier_matches)
    like = views.R[:, 2] @ views.R[:, 2].T > np.cos(np.deg2rad(LIKE_DEG))
    return ids, count, like & ~np.eye(len(ids), dtype=bool)


def _worst_branch(ids: list[int], count: np.ndarray, like: np.ndarray, lost: set[int]) -> set[int]:
    """The smaller part of the tree without the edge across which images from like directions share least; empty where all share
    enough."""
    kept = np.array([i for i, n in enumerate(ids) if n not in lost])
    shared, near = count[np.ix_(kept, kept)], like[np.ix_(kept, kept)]
    tree = minimum_spanning_tree(coo_matrix(np.where(shared > 0, 1 / np.maximum(shared, 1), 0))).tocoo()
    least = FEW * float(np.median(shared[near])) if near.any() else 0.0
    worst: set[int] = set()
    for k in range(tree.nnz):
        others = np.arange(tree.nnz) != k
        cut = coo_matrix((tree.data[others], (tree.row[others], tree.col[others])), shape=shared.shape)
        part = connected_components(cut, directed=False)[1]
        branch = part == part[tree.row[k]]
        across = near & (branch[:, None] != branch[None])
        if across.any() and shared[across].mean() < least:
            least = float(shared[across].mean())
            smaller = branch if 2 * branch.sum() <= len(kept) else ~branch
            worst = {ids[i] for i in kept[smaller]}
    return worst
