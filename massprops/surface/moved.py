"""A closed surface moved along its normals by what images say at some of its vertices.

How much of a move is noise shows in the images: each half of them gives its own, and what the halves have in common is the share
that counts (Spearman 1910; Brown 1910). Silhouettes have no part in that, and so they judge it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

from massprops.surface.cloud import Cloud
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import mean_matrix, vertex_normals
from massprops.surface.silhouette import agreement
from massprops.views import Views

ROUNDS = 2
"""Times that the surface is moved: images say other things of it after each."""
MOST_TRIED = 20_000
"""Vertices that are asked about, at most."""
MOST_AVERAGED = 256
"""Places that are averaged, at most."""
OWN_WEIGHT, STAY_WEIGHT = 0.3, 0.05
"""What a place's own move counts, and all vertices' staying over the places among them, over the difference from the mean of the neighbours.
Where every tenth vertex is one a move fades in seven edges."""
HELD = 1e6
"""The same of what must not move."""
WORSE = 2.0
"""Standard errors of the mean over the images by which the overlap may fall. Moved by windows, of a chair, a padlock and a shoe, whose volumes
came out worse, it fell by 12, 12 and 2.7; of a bottle whose volume went from -3.1 to -1.3 % by 1.6; of three things it rose by 1.4 to 11. That
was before windows kept off the support."""

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices (v, 3), faces (f, 3)."""
Ask = Callable[[Mesh], tuple[np.ndarray, np.ndarray]]
"""Of a mesh: vertices (k,) int, and how far outward it should move there (k,) [world units]."""


def moved(surface: Surface, ask: Ask, views: Views, masks: list[np.ndarray]) -> Surface:
    """The surface with its cloud, moved as images say; what is closed at the support stays.

    Where silhouettes then overlap less, by more than images differ, the surface stays as it was.

    Args:
        ask: what the images say.
        views: n cameras; masks: n undistorted silhouettes (h, w), 255 object, 0 sky.
    """
    vertices, faces, cloud = surface.vertices, surface.faces, surface.cloud
    held = np.zeros(len(vertices), bool)
    held[faces[surface.inferred]] = True
    for _ in range(ROUNDS):
        place, offset = ask((vertices, faces))
        if not len(place):
            break
        along = _over_all(vertices, faces, place, offset, held)
        normal = vertex_normals(vertices, faces)
        cloud = _carried(cloud, vertices, along[:, None] * normal)
        vertices = vertices + along[:, None] * normal
    before, after = (agreement(v, faces, views, masks) for v in (surface.vertices, vertices))
    gain = (after - before)[np.isfinite(after - before)]
    if len(gain) and gain.mean() < -WORSE * gain.std() / np.sqrt(len(gain)):
        return surface
    return replace(surface, vertices=vertices, cloud=cloud)


def in_common(feature: np.ndarray, sigma: float, first: np.ndarray, second: np.ndarray, both: np.ndarray) -> np.ndarray:
    """(k,) what halves of the images have in common of what all of them say.

    Args:
        feature: (k, 6) where it was said; sigma: distance among these within which halves are compared.
        first, second, both: (k,) of either half, and of all.
    """
    wide = averaging(feature, sigma)
    common, size = wide @ (first * second), wide @ (0.5 * (first**2 + second**2))
    share = np.clip(common / np.maximum(size, 1e-12), 0.0, 1.0)
    return np.asarray(2 * share / (1 + share) * both)


def averaging(feature: np.ndarray, sigma: float) -> csr_matrix:
    """Sparse (n, n) matrix of means with normal weights over neighbours in a space of features (n, 6)."""
    from scipy.sparse import csr_matrix
    from scipy.spatial import cKDTree

    near, index = cKDTree(feature).query(feature, min(MOST_AVERAGED, len(feature)), distance_upper_bound=2.5 * sigma)
    near, index = near.reshape(len(feature), -1), index.reshape(len(feature), -1)
    weight = np.exp(-0.5 * (near / sigma) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(feature)), near.shape[1])
    index = np.where(np.isfinite(near), index, 0)
    return csr_matrix((weight.ravel(), (rows, index.ravel())), shape=(len(feature),) * 2)


def spread_out(vertices: np.ndarray, apart: float) -> np.ndarray:
    """Vertices (k,) int, one of each cell of a grid of cells `apart` wide or wider, at most MOST_TRIED."""
    while len(vertices):
        cell = np.floor((vertices - vertices.min(axis=0)) / apart).astype(np.int64)
        chosen = np.asarray(np.unique(cell, axis=0, return_index=True)[1])
        if len(chosen) <= MOST_TRIED:
            return chosen
        apart *= np.sqrt(1.05 * len(chosen) / MOST_TRIED)
    return np.zeros(0, int)


def _over_all(
    vertices: np.ndarray, faces: np.ndarray, place: np.ndarray, offset: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """(v,) offsets of all vertices, from those known at some of them, and none where `held` (v,): as a film over these,
    which nowhere goes beyond them."""
    from scipy.sparse import diags, identity
    from scipy.sparse.linalg import spsolve

    size = len(vertices)
    weight, right = np.full(size, STAY_WEIGHT * len(place) / size), np.zeros(size)
    weight[place], right[place] = OWN_WEIGHT, OWN_WEIGHT * offset
    weight[held], right[held] = HELD, 0.0
    return np.asarray(spsolve((identity(size) - mean_matrix(faces, size) + diags(weight)).tocsc(), right))


def _carried(cloud: Cloud, vertices: np.ndarray, shift: np.ndarray) -> Cloud:
    """The points, each moved as the nearest vertex is by `shift` (v, 3)."""
    from scipy.spatial import cKDTree

    return replace(cloud, xyz=cloud.xyz + shift[cKDTree(vertices).query(cloud.xyz)[1]])
