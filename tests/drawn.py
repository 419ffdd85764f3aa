"""What hypothesis draws for the tests of invariants: numbers, vectors, turns, inertias of bodies that can be."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from massprops.dynamics.quaternion import normalise, rotation_matrix

quickly = settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
"""The same examples each time, and no deadline, which a busy machine would miss."""


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Finite numbers of this range, without those so small that their squares vanish."""
    return st.floats(low, high).map(lambda x: x if abs(x) > 1e-9 else 0.0)


def arrays(shape: int | tuple[int, ...], size: float = 10.0) -> st.SearchStrategy[np.ndarray]:
    """Arrays of numbers within +- size."""
    return hnp.arrays(float, shape, elements=numbers(-size, size))


def turns() -> st.SearchStrategy[np.ndarray]:
    """(4,) unit quaternions."""
    return arrays(4, 1.0).filter(lambda q: np.linalg.norm(q) > 1e-3).map(normalise)


def rotations() -> st.SearchStrategy[np.ndarray]:
    """(3, 3) rotations."""
    return turns().map(rotation_matrix)


def inertias(least: float = 0.02) -> st.SearchStrategy[np.ndarray]:
    """(3, 3) inertias of trace 1 that a body can have: second moments of at least `least` of their sum, any axes."""

    def made(parts: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        second = np.maximum(parts[0] / parts[0].sum(), least)
        sigma = parts[1] @ np.diag(second / second.sum() / 2.0) @ parts[1].T
        return np.trace(sigma) * np.eye(3) - sigma

    return st.tuples(hnp.arrays(float, 3, elements=st.floats(0.05, 1.0)), rotations()).map(made)


def matrices(size: int) -> st.SearchStrategy[np.ndarray]:
    """(size, size) covariances of units that differ by up to a million."""

    def made(parts: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        mix, units = parts
        scale = 10.0**units
        return scale[:, None] * (mix @ mix.T + 0.1 * np.eye(size)) * scale

    return st.tuples(arrays((size, size), 1.0), arrays(size, 3.0)).map(made)
