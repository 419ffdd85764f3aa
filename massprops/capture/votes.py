"""What all images together say of each place in space: whether something stands there that hides the support.

A pixel that differs from the picture of the support is evidence for something before it, and by how much is learned from
the scene itself: from how the pixels of the measured object differ, and from how those of the free support do. The
evidence of all images on a cube of space is added up as in the occupancy grid of Franco and Boyer 2005: where a cube is
object, all images show something there; where it is empty, an image may still show something before or behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from massprops.views import Views

Array = np.ndarray

EDGES = np.concatenate([[0.0], np.geomspace(0.3, 60.0, 32)])
"""Bins of the distance in colour from the support's picture, in its scatters."""
STEADY = np.array([3.0, 6.0, 12.0, 24.0])
"""Scatters of the picture [grey levels] between which evidence is learned apart: at a place that most images do not see,
below the object or at another thing's foot, the scatter is that of what hides it, and nothing differs from it by much."""
LEAST_PIXELS = 100.0
ALIKE = 0.1
"""Share of the pixels of a part that stereo did not measure which look like the support all the same: a dark shackle before its
own shade. The measured part, from which the evidence is learned, says nothing of that. Chosen, as is
`ELSEWHERE`, while looking at that padlock."""
FAINTEST = 1e-3
"""Share of each bin that may be anything: bounds the evidence of one pixel to about the logarithm of its inverse."""
ELSEWHERE = 0.5
"""Chance that a pixel on which an empty cube falls shows something all the same, before or behind the cube."""


@dataclass(frozen=True)
class Evidence:
    """log_odds: (s, b) of something before the support against nothing, by `STEADY` and by bin of `EDGES`."""

    log_odds: np.ndarray

    @staticmethod
    def learn(hidden: tuple[np.ndarray, np.ndarray], free: tuple[np.ndarray, np.ndarray]) -> Evidence:
        """From pixels that the object surely hides, and from surely free ones: of both the distance in colour (m,) from the
        support's picture, and the picture's scatter there (m,)."""
        return Evidence(
            np.stack([
                _log_odds(hidden[0][_steady(hidden[1]) == k], free[0][_steady(free[1]) == k])
                for k in range(len(STEADY) + 1)
            ])
        )  # fmt: skip

    def of(self, off: np.ndarray, scatter: np.ndarray) -> np.ndarray:
        """(h, w) float32 log odds of pixels by their distance in colour and the picture's scatter; 0 where they are NaN."""
        known = np.isfinite(off)
        out = self.log_odds[_steady(np.where(known, scatter, 0.0)), _bin(np.where(known, off, 0.0))]
        return np.where(known, out, 0.0).astype(np.float32)


def _log_odds(hidden: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(b,) log odds by bin of `EDGES`, rising: what differs more is hidden rather more surely."""
    from scipy.optimize import isotonic_regression

    count = [np.bincount(_bin(off), minlength=len(EDGES)) + 0.0 for off in (hidden, free)]
    # a bin that few pixels fall in says little
    share = [(c + LEAST_PIXELS / len(EDGES)) / (c.sum() + LEAST_PIXELS) + FAINTEST for c in count]
    share[0] = (1.0 - ALIKE) * share[0] + ALIKE * share[1]
    weight = share[0] + share[1]
    rising = isotonic_regression(share[0] / weight, weights=weight).x
    return np.asarray(np.log(rising / (1.0 - rising)))


_FINER = 16
_BINS = np.clip(np.searchsorted(EDGES, np.arange(_FINER * int(EDGES[-1]) + 1) / _FINER, side="right") - 1, 0, None)
"""Bin of each sixteenth of a scatter, which is faster than to search for it."""


def _bin(off: np.ndarray) -> np.ndarray:
    """Bins of `EDGES` of distances that are numbers."""
    return np.asarray(_BINS[np.minimum(off * _FINER, len(_BINS) - 1).astype(np.int32)])


def _steady(scatter: np.ndarray) -> np.ndarray:
    return np.searchsorted(STEADY, scatter)


def vote(log_odds: np.ndarray) -> np.ndarray:
    """What a pixel's log odds, of any shape, add to those of a cube that falls on it: bounded above, as something else may be hit."""
    return -np.log(ELSEWHERE + (1.0 - ELSEWHERE) * np.exp(-log_odds))


@dataclass(frozen=True)
class Lattice:
    """Cubes of space: origin (3,) the middle of the first, steps (3, 3) one a row, shape (3,) their numbers."""

    origin: np.ndarray
    steps: np.ndarray
    shape: tuple[int, int, int]

    @property
    def size(self) -> float:
        """Side of a cube."""
        return float(np.linalg.norm(self.steps[0]))

    def part(self, box: tuple[slice, ...]) -> Lattice:
        """The cubes within slices of the three axes."""
        first = np.array([s.start for s in box])
        shape = tuple(s.stop - s.start for s in box)
        return Lattice(self.origin + first @ self.steps, self.steps, (shape[0], shape[1], shape[2]))

    def nearest(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cubes (n, 3) int that hold points (n, 3), and (n,) bool whether there are any."""
        at = np.rint((xyz - self.origin) @ np.linalg.inv(self.steps)).astype(np.int64)
        return at, ((at >= 0) & (at < self.shape)).all(1)


def lattice_on(plane: np.ndarray, vertices: np.ndarray, wider: float, step: float, most: int) -> Lattice:
    """Cubes on a support about a shape.

    Args:
        plane: (4,); vertices: (v, 3) of the shape.
        wider: size of the space over that of the shape.
        step: side of a cube, larger where more than `most` cubes would be needed.
    """
    from massprops.capture.support import axes

    base = np.stack([*axes(plane), plane[:3]])
    at = vertices @ base.T
    low, high = at.min(0), at.max(0)
    ground = -plane[3]
    half = 0.5 * wider * float(max(high[0] - low[0], high[1] - low[1]))
    top = wider * float(high[2] - ground)
    step = max(step, float(np.cbrt(4.0 * half * half * top / most)))
    shape = (int(np.ceil(2 * half / step)), int(np.ceil(2 * half / step)), max(2, int(np.ceil(top / step))))
    middle = 0.5 * (low + high)
    corner = np.array([middle[0] - half, middle[1] - half, ground]) + 0.5 * step
    return Lattice(corner @ base, step * base, shape)


def counted(lattice: Lattice, views: Views, votes: np.ndarray, beyond: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the pixels vote that each cube falls on.

    Args:
        views: n views; votes: (n, h, w) float32 in the geometry of the views.
        beyond: (n, h, w) bool, pixels that the measured shape is not drawn on, nor near.

    Returns:
        (2, a, b, c) float32, sums over every second view, from the first and from the second on; (a, b, c) bool, cubes that
        fall beyond the measured shape in a view.
    """
    P = np.einsum("nij,njk->nik", views.K, np.concatenate([views.R, views.t[:, :, None]], axis=2))
    total, outside = np.zeros((2, *lattice.shape), np.float32), np.zeros(lattice.shape, np.bool_)
    _count(lattice.origin, lattice.steps, votes, beyond, P, total, outside)
    return total, outside


@njit(cache=True, error_model="numpy")
def _count(origin: Array, steps: Array, votes: Array, beyond: Array, P: Array, total: Array, outside: Array) -> None:
    a, b, c = outside.shape
    h, w = votes.shape[1:]
    for v in range(len(P)):
        p, vote, apart, half = P[v], votes[v], beyond[v], total[v % 2]
        u = np.ascontiguousarray(p[:, :3]) @ steps[2]
        for i in range(a):
            for j in range(b):
                x = origin + i * steps[0] + j * steps[1]
                m0 = p[0, 0] * x[0] + p[0, 1] * x[1] + p[0, 2] * x[2] + p[0, 3]
                m1 = p[1, 0] * x[0] + p[1, 1] * x[1] + p[1, 2] * x[2] + p[1, 3]
                m2 = p[2, 0] * x[0] + p[2, 1] * x[1] + p[2, 2] * x[2] + p[2, 3]
                for k in range(c):
                    if m2 > 1e-9:
                        column, row = int(np.floor(m0 / m2 + 0.5)), int(np.floor(m1 / m2 + 0.5))
                        if row >= 0 and column >= 0 and row < h and column < w:
                            half[i, j, k] += vote[row, column]
                            outside[i, j, k] |= apart[row, column]
                    m0 += u[0]
                    m1 += u[1]
                    m2 += u[2]
