"""Two measurements of one body that nothing lays onto each other: whether one contradicts the other.

Where the placements of an object are not joined, each is still a measurement of the same body, closed where it stood and
filled in where nothing was seen. Volume, principal moments and their ratios need no common frame: they must agree.
"""

from __future__ import annotations

import numpy as np

from massprops.mass.integrals import PAIRS, central_inertia
from massprops.mass.intervals import valid_bodies
from massprops.mass.properties import principal_frame
from massprops.surface.hollow import hollowed

TAIL = 0.05
"""Share of the replicates beyond either end of a 90 % interval."""


def holding(
    rows: np.ndarray, body: np.ndarray, others: list[tuple[np.ndarray, np.ndarray]], seed: int
) -> tuple[np.ndarray, int]:
    """Replicates (r, 10) of a body that reach to the other measurements which contradict it, and how many these are.

    One of the two is wrong, and nothing says which, nor by how much: the body may be either, or anything between.

    Args:
        rows, body: (r, 10) and (10,), replicates and integrals of the measurement that is used.
        others: of each other measurement its integrals (10,) and replicates (q, 10), in axes of its own.
        seed: of the draws.
    """
    apart = [other for other, drawn in others if contradict(rows, drawn)]
    for other in apart:
        rows = hollowed(rows, body, body - laid_alike(other, body), seed)
    return rows, len(apart)


def contradict(rows: np.ndarray, others: np.ndarray) -> bool:
    """Whether the 90 % intervals of volume or of a principal moment have nothing in common.

    Args:
        rows, others: (r, 10) and (q, 10) replicates of both (`massprops.mass.integrals`); those that are no bodies do not
            count.
    """
    rows, others = rows[valid_bodies(rows)], others[valid_bodies(others)]
    if not len(rows) or not len(others):
        return False
    one, two = (np.quantile(_values(r), [TAIL, 1.0 - TAIL], axis=0) for r in (rows, others))
    return bool(((one[0] > two[1]) | (two[0] > one[1])).any())


def _values(rows: np.ndarray) -> np.ndarray:
    """(r, 4) volume and principal moments at unit density."""
    volume, _, inertia = central_inertia(rows, 1.0)
    return np.column_stack([volume, np.linalg.eigvalsh(inertia)])


def laid_alike(row: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Integrals (10,) of a body, carried so that its centre of mass and principal axes are those of another.

    Args:
        row, onto: (10,) integrals of the body and of the other.
    """
    volume, _, inertia = central_inertia(row, 1.0)
    _, centre, other = central_inertia(onto, 1.0)
    axes = principal_frame(other)[1]
    turned = axes @ np.diag(np.linalg.eigvalsh(inertia)) @ axes.T
    second = 0.5 * np.trace(turned) * np.eye(3) - turned + volume * np.outer(centre, centre)
    return np.array([volume, *(volume * centre), *(second[a, b] for a, b in PAIRS)])
