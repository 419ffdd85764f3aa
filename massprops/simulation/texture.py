"""Surface texture from seeded noise in body coordinates: the same on every frame, rich at every scale."""

from __future__ import annotations

import numpy as np

LATTICE = 48


class Noise:
    """Several octaves of smooth random values, -1 to 1 or so, periodic far outside any body."""

    def __init__(self, seed: int, size: float, octaves: int = 6, falloff: float = 0.8) -> None:
        """Args: seed; size of the largest texture [m]; octaves; amplitude from one octave to the next."""
        rng = np.random.default_rng([seed, 2])
        self.lattice = rng.uniform(-1, 1, (LATTICE, LATTICE, LATTICE)).astype(np.float32)
        self.shift = rng.uniform(0, LATTICE, (octaves, 3))
        self.size, self.octaves, self.falloff = size, octaves, falloff

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Values (n,) at points (n, 3)."""
        from scipy.ndimage import map_coordinates

        out, amplitude = np.zeros(len(points), np.float32), 1.0
        for k in range(self.octaves):
            where = (points * (2.0**k * 2.0 / self.size) + self.shift[k]).T
            out += amplitude * map_coordinates(self.lattice, where, order=1, mode="grid-wrap", output=np.float32)
            amplitude *= self.falloff
        return out


def panel_lines(points: np.ndarray, spacing: float) -> np.ndarray:
    """1 on dark lines of a grid in body axes, 0 elsewhere; lines are 4 % of the spacing wide."""
    if spacing <= 0:
        return np.zeros(len(points), np.float32)
    fraction = np.abs(points / spacing - np.round(points / spacing))
    return (np.sort(fraction, axis=1)[:, 0] < 0.02).astype(np.float32)
