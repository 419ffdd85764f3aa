"""A closed body cut into layers across a direction, and the space that it closes about within them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprops.surface.hollow import Grid, columns_of, grid_of, runs_of, solid_cells


class Layers(NamedTuple):
    """A body cut across a direction.

    Attributes:
        grid: its third axis is the direction.
        cell, height, face: (c,) where the columns cross the faces; rank: (c,) which crossing of its column.
        piece: (a, b, c) int, which piece of empty space, closed about within its layer; 0 elsewhere.
    """

    grid: Grid
    cell: np.ndarray
    height: np.ndarray
    face: np.ndarray
    rank: np.ndarray
    piece: np.ndarray


def layers_across(vertices: np.ndarray, faces: np.ndarray, up: np.ndarray) -> Layers | None:
    """The layers of a body across `up` (3,) unit; None where its columns do not close.

    Args:
        vertices: (v, 3); faces: (f, 3), closed and wound outward.
    """
    from scipy.ndimage import binary_fill_holes, label

    grid, local = grid_of(vertices, np.array([*up, -float((vertices @ up).min())]))
    cell, height, face = columns_of(grid, local, faces)
    start, count = runs_of(cell)
    if not (count >= 2).any():
        return None
    cells = solid_cells(grid, cell, height, start[count >= 2], count[count >= 2])
    free = np.stack([binary_fill_holes(layer) for layer in np.moveaxis(cells, 2, 0)], axis=2) & ~cells
    in_layer = np.zeros((3, 3, 3), int)
    in_layer[1, :, 1] = in_layer[:, 1, 1] = 1
    rank = np.arange(len(cell)) - np.repeat(start, count)
    return Layers(grid, cell, height, face, rank, label(free, in_layer)[0])
