"""Levenberg-Marquardt: steps of Gauss-Newton, damped until one lowers the cost.

Source: Marquardt, J. SIAM 11 (1963) 431; Madsen, Nielsen and Tingleff, Methods for Non-Linear Least Squares (2004), 3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

P = TypeVar("P")
E = TypeVar("E")


@dataclass(frozen=True)
class Damping:
    """How steps are shortened.

    Attributes:
        start: the first damping; lowered: divides it after a step that lowers the cost, down to `least`; raised: multiplies
            it after one that does not, until it reaches `most` or `tries` steps have failed.
    """

    start: float = 1e-3
    lowered: float = 10.0
    raised: float = 8.0
    least: float = 1e-9
    most: float = 1e8
    tries: int = 1000


@dataclass(frozen=True)
class Step(Generic[P]):
    """Where a step led, the cost there, by how much it fell (0: no step lowers it), and the damping for the next."""

    place: P
    cost: float
    fall: float
    damping: float


def descend(
    place: P,
    linearise: Callable[[P], tuple[float, E]],
    step: Callable[[P, E, float], tuple[float, P] | None],
    most: int,
    damping: Damping = Damping(),
) -> Iterator[Step[P]]:
    """Steps to places of less and less cost; the caller ends the search, or it ends with a step that goes nowhere.

    Args:
        linearise: cost and equations at a place, with the weights renewed where there are any.
        step: cost and place where the equations lead with a damping, the cost with the same weights; None where no shorter
            step is worth a try.
        most: steps.
    """
    value = damping.start
    for _ in range(most):
        cost, equations = linearise(place)
        trial = None
        for _ in range(damping.tries):
            trial = step(place, equations, value) if value < damping.most else None
            if trial is None or trial[0] < cost:
                break
            trial, value = None, value * damping.raised
        if trial is None:
            yield Step(place, cost, 0.0, value)
            return
        (after, place), value = trial, max(value / damping.lowered, damping.least)
        yield Step(place, after, cost - after, value)


def damped_step(normal: np.ndarray, downhill: np.ndarray, damping: float) -> np.ndarray:
    """(k,) step of normal equations (k, k), (k,), their diagonal raised by a part of itself (Marquardt)."""
    return np.linalg.solve(normal + damping * np.diag(np.diag(normal)), downhill)
