"""The most that a body can be: all the space in which its silhouettes leave room for it."""

from __future__ import annotations

import numpy as np

from massprops.mass.integrals import PAIRS
from massprops.surface.outline_cloud import grid_about
from massprops.surface.silhouette import Hull

ROOM = 1.5
"""Radius of the ball about the mesh in which the room is looked for, in radii of the mesh."""
STEPS = 80
"""Samples of the hull along the ball's diameter: a volume is known to some 2 % then, and errs to the larger side."""


def outer_integrals(hull: Hull, vertices: np.ndarray) -> np.ndarray:
    """The ten integrals (10,), as of `massprops.mass.integrals`, of the silhouettes' hull about a mesh; zeros where it has none.

    A body within the hull has no larger volume and, moment for moment, no larger inertia: its tensor about its own centre
    of mass is at most that about the hull's, and this is at most the hull's own (Weyl's inequality for a sum of positive
    semidefinite matrices).

    Args:
        vertices: (v, 3) of the mesh.
    """
    from scipy.ndimage import label

    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = ROOM * float(np.linalg.norm(vertices - middle, axis=1).max())
    grid, step = grid_about(middle, radius, STEPS)
    inside = (hull.value(grid.reshape(-1, 3)) < 0.5 * step / hull.pixel).reshape(grid.shape[:3])
    # what does not hang together with the mesh is room between silhouettes, or beyond the images
    piece, _ = label(inside)
    corner = np.floor((vertices - middle + radius) / step).astype(int)
    about = [piece[tuple((corner + c).T)] for c in np.ndindex(2, 2, 2)]
    points = grid[np.isin(piece, np.setdiff1d(about, 0))]
    second = [(points[:, i] * points[:, j]).sum() for i, j in PAIRS]
    return step**3 * np.array([len(points), *points.sum(axis=0), *second])
