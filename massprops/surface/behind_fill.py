"""Space behind the filled-in sides of a body that was seen from all about: what of it may be empty.

A body that was turned over has no unseen underside. What is still not measured of it was in view and too dark, too glossy or
too plain, and a dark side may be the mouth of a hollow: a cup is filled to its rim where nothing was measured inside. What
was measured proves a wall and no more (`hollow`); what can be reached from the filled sides without crossing a wall may be
empty.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.hollow import RESOLVED, integrals_of, solid_of, wall_thickness, within


def behind_fill(
    vertices: np.ndarray, faces: np.ndarray, observed: np.ndarray, noise: float, spacing: float
) -> np.ndarray:
    """Integrals (10,) of the space that may be empty, about the origin of the vertices (`massprops.mass.integrals`).

    Args:
        vertices: (v, 3); faces: (f, 3), closed and wound outward; observed: (f,) bool.
        noise: of the measured surface, the least thickness that it proves.
        spacing: of the vertices.
    """
    from scipy.ndimage import label

    grid, solid = solid_of(vertices, faces)
    index = np.argwhere(solid)
    walls = faces[observed]
    wall = wall_thickness(vertices, walls)
    loose = np.zeros(solid.shape, bool)
    middle = grid.world(index)
    free = ~within(middle, vertices, walls, wall if wall > RESOLVED * spacing else noise)
    loose[tuple(index.T)] = free
    piece, _ = label(loose)
    own = piece[tuple(index.T)]
    mouth = np.unique(own[free & within(middle, vertices, faces[~observed], 2.0 * float(grid.step.max()))])
    return integrals_of(np.argwhere(np.isin(piece, mouth[mouth > 0])), grid)
