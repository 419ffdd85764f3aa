"""What holds of tetrahedra, smoothed meshes and joined bodies whatever the points are."""

from __future__ import annotations

import numpy as np
import trimesh
from drawn import arrays, quickly, rotations
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from massprops.exchange.alignment import distinct, rotation_net
from massprops.geometry.vectors import turn_deg
from massprops.mass.bodies import one_solid
from massprops.surface.refine import edge_length, fair, smoothed_face_normals, vertex_normals
from massprops.surface.tetra import tetrahedralise

CORNERS = np.vstack([np.eye(3), [[-1.0, -1.0, -1.0]]]) * 20.0
"""A tetrahedron about all points that are drawn, so that no cloud is flat."""


@quickly
@given(arrays((8, 3)))
def test_tetrahedra_fill_the_hull_of_their_points(points: np.ndarray) -> None:
    points = np.vstack([np.unique(points, axis=0), CORNERS])
    tetra = tetrahedralise(points)
    assert np.isclose(tetra.volume.sum(), ConvexHull(points).volume)
    t, k, other, back = tetra.facets
    np.testing.assert_array_equal(tetra.neighbours[t, k], other)
    np.testing.assert_array_equal(tetra.neighbours[other, back], t)
    assert tetra.facet_area.min() >= 0
    start, owner = tetra.incidence
    assert start[-1] == tetra.corners.size and len(owner) == tetra.corners.size


@quickly
@given(arrays((42, 3), 0.05), rotations(), st.floats(0.1, 10.0), st.lists(st.integers(0, 41), max_size=10))
def test_smoothing_turns_and_grows_with_the_mesh_and_leaves_what_is_fixed(
    rough: np.ndarray, R: np.ndarray, factor: float, fixed: list[int]
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1)
    vertices, faces = np.asarray(ball.vertices) + rough, np.asarray(ball.faces)
    held = np.isin(np.arange(42), fixed)
    smooth = fair(vertices, faces, held, 3)
    np.testing.assert_array_equal(smooth[held], vertices[held])
    np.testing.assert_allclose(fair(factor * vertices @ R.T, faces, held, 3), factor * smooth @ R.T, atol=1e-9 * factor)
    assert np.isclose(edge_length(factor * vertices @ R.T, faces), factor * edge_length(vertices, faces))
    for normals in (vertex_normals, smoothed_face_normals):
        n = normals(vertices, faces)
        np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
        np.testing.assert_allclose(normals(vertices @ R.T, faces), n @ R.T, atol=1e-9)


@quickly
@given(arrays(3, 1.5), st.booleans())
def test_bodies_that_overlap_count_once_and_in_any_order(apart: np.ndarray, inward: bool) -> None:
    one, two = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1))
    two.apply_translation(apart)
    shared = float(np.prod(np.maximum(1.0 - np.abs(apart), 0.0)))
    if inward and shared == 0.0:
        two.invert()
    for pair in ((one, two), (two, one)):
        whole, notes = one_solid(trimesh.util.concatenate(pair))
        assert np.isclose(whole.volume, 2.0 - shared, atol=1e-5)
        assert bool(notes) or shared < 1e-5


@quickly
@given(st.integers(2, 60), st.floats(1.0, 90.0))
def test_rotations_that_are_taken_are_apart(count: int, apart: float) -> None:
    net = rotation_net(count)
    np.testing.assert_allclose(np.einsum("nij,nkj->nik", net, net), np.tile(np.eye(3), (count, 1, 1)), atol=1e-9)
    taken = distinct(net, np.arange(count), count, apart)
    assert taken[0] == 0 and len(set(taken)) == len(taken)
    assert all(turn_deg(net[a], net[b]) > apart - 1e-6 for a in taken for b in taken if a != b)
