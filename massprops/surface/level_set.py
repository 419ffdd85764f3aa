"""The surface where a function on a regular grid changes its sign, closed and without crossings.

Marching tetrahedra (Doi and Koide 1991) on Kuhn's six tetrahedra of each cube, which fit together across cubes: every
edge of the surface has two faces, whatever the signs.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

CORNERS = np.array([np.cumsum([[0, 0, 0], *np.eye(3, dtype=int)[list(p)]], axis=0) for p in permutations(range(3))])
"""(6, 4, 3) corners of the tetrahedra of a cube, from its first corner to its last."""


def level_set(value: np.ndarray, origin: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and outward-wound faces (f, 3) int32 of the region where `value` is negative.

    Args:
        value: (a, b, c) on a grid; the border counts as positive.
        origin: (3,) place of value[0, 0, 0]; step: of the grid.
    """
    whole = np.where(value == 0.0, 1e-9, value).astype(float)
    for axis in range(3):
        for end in (0, -1):
            side = np.moveaxis(whole, axis, 0)
            side[end] = np.abs(side[end])
    inside = whole < 0
    count = sum(
        inside[i : len(inside) - 1 + i, j : inside.shape[1] - 1 + j, k : inside.shape[2] - 1 + k].astype(np.int8)
        for i, j, k in np.ndindex(2, 2, 2)
    )
    cube = np.argwhere((count > 0) & (count < 8))
    flat = np.array([whole.shape[1] * whole.shape[2], whole.shape[2], 1])
    corner = (cube[:, None, None, :] + CORNERS) @ flat  # (cubes, 6, 4)
    corner = corner.reshape(-1, 4)
    edges = np.concatenate([_triangles(corner, inside.ravel()[corner], many) for many in (1, 2, 3)])
    low, high = edges.min(axis=2).astype(np.int64), edges.max(axis=2).astype(np.int64)
    key, faces = np.unique(low * whole.size + high, return_inverse=True)
    a, b = key // whole.size, key % whole.size
    va, vb = whole.ravel()[a], whole.ravel()[b]
    # a little off the grid's points: no face is without area
    share = np.clip(va / (va - vb), 0.01, 0.99)[:, None]
    place = [np.stack(np.unravel_index(i, whole.shape), axis=1) for i in (a, b)]
    vertices = np.asarray(origin) + step * (place[0] + share * (place[1] - place[0]))
    faces = faces.reshape(-1, 3)
    # each face looks from the end of its first edge that is inside to the one that is outside
    within, outside = (np.stack(np.unravel_index(edges[:, 0, k], whole.shape), axis=1) for k in (0, 1))
    outward = outside - within
    x = vertices[faces]
    wrong = np.einsum("fi,fi->f", np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), outward) < 0
    faces[wrong] = faces[wrong][:, ::-1]
    return vertices, faces.astype(np.int32)


def _triangles(corner: np.ndarray, inside: np.ndarray, many: int) -> np.ndarray:
    """(f, 3, 2) the grid's edges, from inside to outside, on which the vertices of faces lie; of tetrahedra (n, 4) with
    `many` corners inside."""
    with_many = inside.sum(axis=1) == many
    order = np.argsort(~inside[with_many], axis=1, kind="stable")  # those inside come first
    c = np.take_along_axis(corner[with_many], order, axis=1)

    def cut(i: int, j: int) -> np.ndarray:
        return c[:, [i, j]]

    if many == 1:
        return np.stack([cut(0, 1), cut(0, 2), cut(0, 3)], axis=1)
    if many == 3:
        return np.stack([cut(0, 3), cut(1, 3), cut(2, 3)], axis=1)
    one = np.stack([cut(0, 2), cut(0, 3), cut(1, 3)], axis=1)
    other = np.stack([cut(0, 2), cut(1, 3), cut(1, 2)], axis=1)
    return np.concatenate([one, other])
