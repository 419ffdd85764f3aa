"""What a difference between the assumed and the moved inertia says about mass that the even shape does not have."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.rotation import six_of


def point_mass(assumed: np.ndarray, found: np.ndarray) -> dict[str, Any]:
    """The point mass that explains the difference best.

    A point of reduced mass mu at p from the body's centre adds mu (|p|^2 1 - p p^T). Motion gives the inertia without
    its size, so four numbers are fitted to five: p sqrt(mu), over the root of the mean moment, and the size.

    Args:
        assumed, found: (3, 3), mean moment 1, same axes.

    Returns:
        `direction` (unit, body axes, either sign), `second_moment` mu |p|^2 over the body's mean moment, `left` the
        share of the difference that no point explains, and what stays unknown.
    """
    from scipy.optimize import least_squares

    target = np.array(six_of(found - assumed))

    def off(x: np.ndarray) -> np.ndarray:
        whole = assumed + x @ x * np.eye(3) - np.outer(x, x)
        whole = 3.0 * whole / np.trace(whole)
        return np.array(six_of(whole - found))

    best = None
    for axis in (*np.eye(3), *np.linalg.eigh(found - assumed)[1].T):
        tried = least_squares(off, 0.2 * axis + 1e-3)
        if best is None or tried.cost < best.cost:
            best = tried
    assert best is not None
    size = float(np.linalg.norm(best.x))
    return {
        "direction": (best.x / max(size, 1e-300)).tolist(),
        "second_moment": size**2,
        "left": float(np.linalg.norm(best.fun)) / max(float(np.linalg.norm(target)), 1e-300),
        "unknown": "which of the two opposite sides, and mass apart from distance: the motion shows mass times distance squared",
    }
