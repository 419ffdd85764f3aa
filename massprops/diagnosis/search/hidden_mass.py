"""What a difference between the assumed and the moved inertia says about mass that the even shape does not have."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.rotation import six_of
from massprops.model.state import inertia_of, second_moment

ALIKE = 0.1
"""Difference of the share left over below which a point and a gradient explain alike."""
UNKNOWN = (
    "which of the two opposite sides, and mass apart from distance: the motion shows mass times distance squared; "
    "a gradient's first order, which a shape that is not its own mirror image would show, is left out"
)


def hidden_mass(assumed: np.ndarray, found: np.ndarray) -> dict[str, Any]:
    """The point mass and the density gradient that each explain the difference best.

    With the second moments S = int x x^T dm about the centre of mass, a point of reduced mass mu at p adds mu p p^T.
    A gradient g of a shape that is its own mirror image, of mass m, leaves int x x^T dm as it was and moves the centre of
    mass by c = S g / m, so it takes m c c^T away. Motion gives the inertia without its size: three numbers of either are
    fitted to five.

    Args:
        assumed, found: (3, 3), mean moment 1, same axes.

    Returns:
        `direction` (unit, body axes, either sign), `second_moment` mu |p|^2 over the body's mean moment and `left`, the
        share of the difference that no point explains; `gradient` with `direction` (of the steepest rise of density),
        `shift_direction` (of the centre of mass), `second_moment` m |c|^2 over the mean moment and `left`; `better`: what
        leaves less, or `either`; `unknown`: what ratios and axes cannot tell.
    """
    S = second_moment(assumed)
    p, mass_left = _rank_one(S, found, 1.0)
    c, gradient_left = _rank_one(S, found, -1.0)
    better = "point mass" if mass_left < gradient_left else "density gradient"
    return {
        "direction": _unit(p),
        "second_moment": float(p @ p),
        "left": mass_left,
        "gradient": {
            "direction": _unit(np.linalg.solve(S + 1e-9 * np.eye(3), c)),
            "shift_direction": _unit(c),
            "second_moment": float(c @ c),
            "left": gradient_left,
        },
        "better": "either" if abs(mass_left - gradient_left) < ALIKE else better,
        "unknown": UNKNOWN,
    }


def _rank_one(S: np.ndarray, found: np.ndarray, sign: float) -> tuple[np.ndarray, float]:
    """x (3,) so that S + sign x x^T is the second moment found but for its size, and the share of the change left over."""
    from scipy.optimize import least_squares

    change = np.array(six_of(found - inertia_of(S)))

    def off(x: np.ndarray) -> np.ndarray:
        return np.array(six_of(inertia_of(S + sign * np.outer(x, x)) - found))

    axes = np.linalg.eigh(found - inertia_of(S))[1]
    starts = [0.2 * axis + 1e-3 for axis in (*np.eye(3), *axes.T)]
    best = min((least_squares(off, start) for start in starts), key=lambda tried: tried.cost)
    return best.x, float(np.linalg.norm(best.fun)) / max(float(np.linalg.norm(change)), 1e-300)


def _unit(x: np.ndarray) -> list[float]:
    return list(map(float, x / max(float(np.linalg.norm(x)), 1e-300)))
