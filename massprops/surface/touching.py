"""Vertices that coincide although they belong to parts of a surface that only touch, moved apart.

A boolean difference of solids leaves two vertices at one place where what is left touches itself. The mesh is closed all the same,
but a program that merges what coincides when it reads a file finds edges with four faces.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.refine import edge_length, vertex_normals

APART = 1e-3
"""Length by which such a vertex moves into the body, in edges of the mesh: it shows in single precision, and nowhere else."""
ROUNDS = 3


def parted(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertices (v, 3) of which no two coincide in single precision, each moved along its own normal where they did.

    Args:
        vertices: (v, 3); faces: (f, 3) of a closed mesh.
    """
    out = vertices
    for k in range(1, ROUNDS + 1):
        _, which, count = np.unique(out.astype(np.float32), axis=0, return_inverse=True, return_counts=True)
        twice = count[which.ravel()] > 1
        if not twice.any():
            break
        # twins whose normals are alike part by going different ways
        way = np.arange(1, twice.sum() + 1) / twice.sum()
        out = out.copy()
        step = k * APART * edge_length(vertices, faces)
        out[twice] -= step * way[:, None] * vertex_normals(out, faces)[twice]
    return out
