"""A mesh as a pinhole camera sees it."""

from __future__ import annotations

import numpy as np
import trimesh

from massprops.geometry.rasterise import rasterise, silhouette

K = np.array([[400.0, 0, 159.5], [0, 400.0, 119.5], [0, 0, 1]])
R, t = np.eye(3), np.array([0.0, 0, 5.0])


def test_a_ball_is_a_disc_at_its_distance() -> None:
    ball = trimesh.creation.icosphere(5, 1.0)
    depth, face = rasterise(ball.vertices, ball.faces, K, R, t, (320, 240))
    # the cone that touches a unit ball at distance 5 has the tangent 1 / sqrt(24)
    radius = 400 / np.sqrt(24)
    assert np.isclose(np.count_nonzero(face >= 0), np.pi * radius**2, rtol=0.005)
    assert np.isclose(depth[119:121, 159:161].mean(), 4.0, atol=1e-3)
    assert np.array_equal(np.isfinite(depth), face >= 0)
    assert (silhouette(ball.vertices, ball.faces, K, R, t, (320, 240)) == (face >= 0)).all()


def test_the_nearer_face_is_seen_and_what_is_behind_the_camera_is_not() -> None:
    near = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    vertices = np.concatenate([near, near + [0, 0, 1], near - [0, 0, 10]])
    depth, face = rasterise(vertices, np.arange(9).reshape(3, 3)[::-1], K, R, t, (320, 240))
    assert face[119, 159] == 2 and np.isclose(depth[119, 159], 5.0)


def test_depth_of_a_slanted_face_is_exact() -> None:
    vertices = np.array([[-3.0, -3, -2], [3, -3, 2], [0, 4, 0]])
    depth, face = rasterise(vertices, np.array([[0, 1, 2]]), K, R, t, (320, 240))
    v, u = np.argwhere(face >= 0)[::97].T
    ray = np.column_stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(len(u))])
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    expected = normal @ (vertices[0] + t) / (ray @ normal)
    assert np.allclose(depth[v, u], expected, rtol=1e-9)


def test_a_silhouette_is_where_faces_are_seen() -> None:
    rng = np.random.default_rng(3)
    vertices = rng.normal(0, 1.2, (200, 3)) + [0, 0, -3]  # some behind the camera, some beside the image
    faces = rng.integers(0, 200, (7, 3))
    _, face = rasterise(vertices, faces, K, R, t, (320, 240))
    assert (silhouette(vertices, faces, K, R, t, (320, 240)) == (face >= 0)).all()
    assert 0.1 < (face >= 0).mean() < 1
