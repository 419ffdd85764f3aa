"""The model unit: the greatest length of a measured surface."""

import numpy as np
import pytest
import trimesh

from massprops.surface.length import model_length


@pytest.fixture
def rod() -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.capsule(height=1.0, radius=0.1, count=(48, 48))
    mesh = mesh.subdivide_to_size(0.02)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def test_smooth_body_keeps_its_length(rod):
    vertices, faces = rod
    length, a, b = model_length(vertices, faces, np.ones(len(faces), bool))
    assert length == pytest.approx(np.ptp(vertices[:, 2]), rel=5e-4)
    assert np.linalg.norm(vertices[a] - vertices[b]) == pytest.approx(length, rel=5e-4)


def test_a_hair_counts_less(rod):
    vertices, faces = rod
    exact = np.ptp(vertices[:, 2])
    vertices = vertices.copy()
    vertices[np.argmax(vertices[:, 2]), 2] += 0.02
    assert np.ptp(vertices[:, 2]) - exact == pytest.approx(0.02)
    assert model_length(vertices, faces, np.ones(len(faces), bool))[0] - exact < 0.016


def test_a_filled_end_does_not_count(rod):
    vertices, faces = rod
    vertices = vertices.copy()
    exact = np.ptp(vertices[:, 2])
    top = vertices[:, 2] > vertices[:, 2].max() - 0.01
    vertices[top, 2] += 0.03
    observed = ~top[faces].any(axis=1)
    assert model_length(vertices, faces, observed)[0] < exact + 0.002


def test_a_needle_of_the_fill_does_not_count(rod):
    vertices, faces = rod
    vertices = vertices.copy()
    exact = np.ptp(vertices[:, 2])
    tip = np.argmax(vertices[:, 2])
    vertices[tip, 2] += 0.15
    observed = ~(faces == tip).any(axis=1)
    assert model_length(vertices, faces, observed)[0] < 1.01 * exact


def test_a_filled_half_counts(rod):
    vertices, faces = rod
    observed = (vertices[:, 2] < 0.2)[faces].all(axis=1)
    assert model_length(vertices, faces, observed)[0] == pytest.approx(np.ptp(vertices[:, 2]), rel=0.02)


def test_a_tip_with_one_face_that_was_not_measured_counts(rod):
    vertices, faces = rod
    tip = int(np.argmax(vertices[:, 2]))
    observed = np.ones(len(faces), bool)
    observed[np.flatnonzero((faces == tip).any(axis=1))[0]] = False
    whole = model_length(vertices, faces, np.ones(len(faces), bool))
    assert model_length(vertices, faces, observed) == whole
