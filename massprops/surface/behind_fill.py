"""Space behind the filled-in sides of a body that was seen from all about: what of it may be empty.

What was in view and was not measured all the same was too dark, too glossy or too plain, and a dark side may be the mouth of
a hollow: a cup is filled to its rim where nothing was measured inside, whether it stands or was turned over. What is known
to be surface proves a wall and no more (`hollow`); what can be reached from the other sides without crossing a wall may be
empty.
"""

from __future__ import annotations

import numpy as np

from massprops.surface.hollow import RESOLVED, integrals_of, solid_of, wall_thickness, within


def behind_fill(
    vertices: np.ndarray,
    faces: np.ndarray,
    known: np.ndarray,
    noise: float,
    spacing: float,
    walls_alike: bool = True,
) -> np.ndarray:
    """Integrals (10,) of the space that may be empty, about the origin of the vertices (`massprops.mass.integrals`).

    Args:
        vertices: (v, 3); faces: (f, 3), closed and wound outward; known: (f,) bool, the face is the object's surface.
        noise: of the measured surface, the least thickness that it proves.
        spacing: of the vertices.
        walls_alike: its walls are as thick as those that were seen from both sides; else as thin as the noise.
    """
    from scipy.ndimage import label

    grid, solid = solid_of(vertices, faces)
    index = np.argwhere(solid)
    walls = faces[known]
    wall = wall_thickness(vertices, walls) if walls_alike else 0.0
    loose = np.zeros(solid.shape, bool)
    middle = grid.world(index)
    free = ~within(middle, vertices, walls, wall if wall > RESOLVED * spacing else noise)
    loose[tuple(index.T)] = free
    piece, _ = label(loose)
    piece_of_cell = piece[tuple(index.T)]
    mouth = np.unique(piece_of_cell[free & within(middle, vertices, faces[~known], 2.0 * float(grid.step.max()))])
    return integrals_of(np.argwhere(np.isin(piece, mouth[mouth > 0])), grid)
