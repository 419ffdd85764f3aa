"""One flat side of a body, on a grid of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Plane = tuple[np.ndarray, float]
"""Unit normal (3,) and offset."""
STEP, MARGIN = 1.5, 2
"""Between places of a side's grid [spacings], and places beyond what was measured."""


@dataclass(frozen=True)
class FlatSide:
    """One flat side: where it was measured, and where it may go on.

    Attributes:
        normal: (3,) unit, outward; offset: of its plane, normal . x = offset.
        base: (2, 3) unit vectors in the plane.
        low: (2,) of the grid's first place [world units], in `base`; step: of the grid.
        measured: (a, b) bool, places of the grid at which it was measured.
        goes_on: (a, b) bool, places beside these to which it may go on.
    """

    normal: np.ndarray
    offset: float
    base: np.ndarray
    low: np.ndarray
    step: float
    measured: np.ndarray
    goes_on: np.ndarray

    @staticmethod
    def about(xyz: np.ndarray, plane: Plane, spacing: float) -> FlatSide:
        """A side in a plane, measured nowhere, whose grid holds the feet of points (k, 3); spacing: of measured points."""
        normal, offset = plane
        first = np.linalg.svd(normal[None])[2][1]
        base = np.stack([first, np.cross(normal, first)])
        step = STEP * spacing
        flat = xyz @ base.T
        low = flat.min(0) - MARGIN * step
        size = np.ceil((flat.max(0) - low) / step).astype(int) + MARGIN + 1
        return FlatSide(normal, offset, base, low, step, np.zeros(size, bool), np.zeros(size, bool))

    def place(self, xyz: np.ndarray) -> np.ndarray:
        """(k, 2) int: the places on its grid nearest to the feet of points (k, 3)."""
        return np.floor((xyz @ self.base.T - self.low) / self.step + 0.5).astype(np.int64)

    def height(self, xyz: np.ndarray) -> np.ndarray:
        """(k,) of points above it [world units]."""
        return np.asarray(xyz @ self.normal - self.offset)

    def on(self, xyz: np.ndarray, where: np.ndarray) -> np.ndarray:
        """(k,) bool: the foot of points (k, 3) on it lies where an (a, b) grid says so."""
        at = self.place(xyz)
        inside = np.asarray(((at >= 0) & (at < where.shape)).all(1))
        return np.asarray(inside & where[tuple(np.where(inside[:, None], at, 0).T)])

    def places(self, where: np.ndarray) -> np.ndarray:
        """(k, 3) places on the plane at which an (a, b) grid is True."""
        return self.offset * self.normal + (self.low + self.step * np.argwhere(where)) @ self.base
