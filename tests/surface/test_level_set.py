"""The surface of a function on a grid: closed, outward, of the right volume."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.surface.level_set import level_set


def sampled(function, n: int = 41) -> tuple[np.ndarray, np.ndarray, float]:  # type: ignore[no-untyped-def]
    flat = np.linspace(-1.3, 1.3, n)
    grid = np.stack(np.meshgrid(flat, flat, flat, indexing="ij"), axis=-1)
    return function(grid), np.full(3, -1.3), float(flat[1] - flat[0])


def test_a_ball_has_its_volume_and_its_surface_lies_on_it() -> None:
    vertices, faces = level_set(*sampled(lambda x: np.linalg.norm(x - 0.07, axis=-1) - 1.0))
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_volume and mesh.body_count == 1
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=5e-3)
    assert np.abs(np.linalg.norm(vertices - 0.07, axis=1) - 1.0).max() < 2e-3


def test_any_signs_make_a_closed_surface() -> None:
    value = np.random.default_rng(3).standard_normal((9, 10, 11))
    value[4, 4, 4] = 0.0
    vertices, faces = level_set(value, np.zeros(3), 1.0)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0


def test_a_region_that_reaches_the_border_is_closed_there() -> None:
    vertices, faces = level_set(*sampled(lambda x: x[..., 2] - 0.5 + 0 * x[..., 0], 21))
    assert trimesh.Trimesh(vertices, faces, process=False).is_volume
