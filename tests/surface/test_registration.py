"""Two placements of one body laid onto each other."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras, observe

from massprops.dynamics.quaternion import rotation_matrix
from massprops.surface.registration import Placed, register
from massprops.surface.silhouette import make_hull


def placed(mesh: trimesh.Trimesh, painted: bool, seed: int) -> Placed:
    """What cameras above a body see of it; its colour depends on the place on the body."""
    rng = np.random.default_rng(seed)
    a = np.arange(12) * 0.95
    up = np.column_stack([np.cos(a), np.sin(a), rng.uniform(0.3, 1.5, 12)])
    views = cameras(up, 8.0, 300.0, (160, 120))
    cloud, masks = observe(mesh, views, 0.004, seed)
    local = (cloud.xyz - mesh.metadata["t"]) @ mesh.metadata["R"]
    waves = np.array([[7.0, 3, 2], [-4, 6, 5], [2, -5, 8]])
    colour = 128 + 80 * np.sin(local @ waves.T + [0.3, 1.1, 2.0]) if painted else 0 * cloud.xyz
    return Placed(cloud, colour, make_hull(views, masks, cloud.xyz), np.asarray(mesh.center_mass))


def turned(mesh: trimesh.Trimesh, q: np.ndarray, t: np.ndarray) -> trimesh.Trimesh:
    out = mesh.copy()
    R = rotation_matrix(q / np.linalg.norm(q))
    out.vertices = mesh.vertices @ R.T + t
    out.metadata["R"], out.metadata["t"] = R, t
    return out


def wedge() -> trimesh.Trimesh:
    """A body without symmetry."""
    base = trimesh.creation.box((1.6, 1.0, 0.5))
    knob = trimesh.creation.icosphere(3, 0.35)
    knob.apply_translation([0.5, 0.2, 0.35])
    return trimesh.convex.convex_hull(np.concatenate([base.vertices, knob.vertices]))


def error_deg(R: np.ndarray, first: trimesh.Trimesh, second: trimesh.Trimesh) -> float:
    wanted = first.metadata["R"] @ second.metadata["R"].T
    return float(np.degrees(np.arccos(np.clip((np.trace(R.T @ wanted) - 1) / 2, -1, 1))))


def test_a_body_turned_over_is_found_by_its_shape() -> None:
    first = turned(wedge(), np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(wedge(), np.array([0.1, 0.9, 0.3, 0.2]), np.array([0.05, -0.1, 0.02]))
    found = register(placed(first, True, 0), placed(second, True, 1))
    assert found.clear and error_deg(found.R, first, second) < 1.5
    here = np.asarray(second.center_mass) @ found.R.T + found.t
    assert np.linalg.norm(here - first.center_mass) < 0.03


@pytest.mark.parametrize("painted", [True, False])
def test_a_symmetric_body_is_joined_by_colour_or_not_at_all(painted: bool) -> None:
    box = trimesh.creation.box((1.6, 1.0, 0.6))
    first = turned(box, np.array([1.0, 0, 0, 0]), np.zeros(3))
    second = turned(box, np.array([0.0, 1.0, 0.02, 0.01]), np.zeros(3))
    found = register(placed(first, painted, 2), placed(second, painted, 3))
    assert found.clear == painted
    if painted:
        assert error_deg(found.R, first, second) < 2
