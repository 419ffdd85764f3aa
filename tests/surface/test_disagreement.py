"""Two measurements of one body that nothing lays onto each other."""

from __future__ import annotations

import numpy as np
import trimesh

from massprops.mass.integrals import central_inertia, mesh_integrals
from massprops.mass.intervals import intervals, valid_bodies
from massprops.mass.properties import principal_frame, properties_of_integrals
from massprops.surface.disagreement import contradict, holding, laid_alike

TURN = trimesh.transformations.random_rotation_matrix(np.random.default_rng(3).random(3))
TURN[:3, 3] = [2.0, -1.0, 0.5]


def integrals(size: tuple[float, float, float], turned: bool = False) -> np.ndarray:
    mesh = trimesh.creation.box(size)
    mesh.apply_transform(TURN if turned else trimesh.transformations.translation_matrix([0.1, 0.2, 0.3]))
    return mesh_integrals(mesh.vertices, mesh.faces)


def scattered(row: np.ndarray, sigma: float, seed: int = 0) -> np.ndarray:
    """Replicates of relative volume sigma."""
    return row * (1 + sigma * np.random.default_rng(seed).standard_normal((1000, 1)))


SOLID, SHELL = integrals((3, 2, 1)), integrals((2.6, 1.8, 0.5), turned=True)


def test_a_body_is_carried_onto_the_others_axes_and_stays_the_same_body() -> None:
    found = laid_alike(SHELL, SOLID)
    one, two, own = (central_inertia(r, 1.0) for r in (found, SOLID, SHELL))
    assert np.isclose(one[0], own[0]) and np.allclose(one[1], two[1])
    assert np.allclose(np.linalg.eigvalsh(one[2]), np.linalg.eigvalsh(own[2]))
    assert np.allclose(np.abs(principal_frame(one[2])[1].T @ principal_frame(two[2])[1]), np.eye(3), atol=1e-9)


def test_only_intervals_that_exclude_each_other_contradict() -> None:
    assert contradict(scattered(SOLID, 0.05), scattered(SHELL, 0.05, 1))
    assert not contradict(scattered(SOLID, 0.5), scattered(SHELL, 0.9, 1))
    long = integrals((6, 1, 1), turned=True)
    assert contradict(scattered(SOLID, 0.05), scattered(long, 0.05, 1)), "of equal volume, but of other moments"
    assert not contradict(scattered(SOLID, 0.05), np.full((10, 10), -1.0)), "what is no body says nothing"


def test_the_interval_reaches_to_what_contradicts_it_and_no_farther_otherwise() -> None:
    """As of a toy car, twice as large standing on its hollow underside as it is."""
    rows = scattered(SOLID, 0.05)
    kept, none = holding(rows, SOLID, [(SHELL, scattered(SHELL, 2.0, 1))], 0)
    assert none == 0 and np.array_equal(kept, rows)
    wide, one = holding(rows, SOLID, [(SHELL, scattered(SHELL, 0.05, 1))], 0)
    assert one == 1 and valid_bodies(wide).all()
    bounds = intervals(wide, properties_of_integrals(SOLID, 1.0))
    assert bounds["volume"][0] < 1.05 * SHELL[0] and bounds["volume"][1] > 0.98 * SOLID[0]
    moments = np.linalg.eigvalsh(central_inertia(SHELL, 1.0)[2])
    assert all(low < 1.05 * m < high for (low, high), m in zip(bounds["principal_moments"], moments, strict=True))
