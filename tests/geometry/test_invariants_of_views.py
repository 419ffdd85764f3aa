"""What holds of vectors, cameras and drawn triangles whatever the numbers are."""

from __future__ import annotations

import numpy as np
from drawn import arrays, numbers, quickly, rotations
from hypothesis import given
from hypothesis import strategies as st

from massprops.geometry.epipolar import fundamental, sampson
from massprops.geometry.facing import facing_points
from massprops.geometry.interpolation import bilinear, peak
from massprops.geometry.projection import project
from massprops.geometry.rasterise import rasterise
from massprops.geometry.vectors import angles_deg, skew, sphere, turn_deg, unit

K = np.array([[80.0, 0, 31.5], [0, 90.0, 23.5], [0, 0, 1]])
BEFORE = np.array([0.0, 0.0, 30.0])
"""So far off that all points that are drawn lie before the camera."""


@quickly
@given(arrays((4, 3)), arrays(3))
def test_the_matrix_of_a_cross_product_is_skew_and_blind_along_its_vector(v: np.ndarray, b: np.ndarray) -> None:
    S = skew(v)
    np.testing.assert_array_equal(S, -np.swapaxes(S, 1, 2))
    np.testing.assert_allclose(S @ b, np.cross(v, b), atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", S, v), 0.0, atol=1e-12)


@quickly
@given(arrays((5, 3)), rotations())
def test_directions_and_angles_between_them_turn_with_the_axes(v: np.ndarray, R: np.ndarray) -> None:
    size = np.linalg.norm(unit(v), axis=1)
    assert np.all(np.isclose(size, 1.0) | (size == 0.0))
    np.testing.assert_allclose(angles_deg(v @ R.T), angles_deg(v), atol=1e-4)


@quickly
@given(rotations(), rotations())
def test_the_angle_between_rotations_is_the_same_either_way(A: np.ndarray, B: np.ndarray) -> None:
    assert 0.0 <= turn_deg(A, B) <= 180.0
    assert np.isclose(turn_deg(A, B), turn_deg(B, A), atol=1e-4) and turn_deg(A, A) < 1e-4


@quickly
@given(st.integers(2, 3000))
def test_directions_over_the_sphere_have_length_one_and_no_side(count: int) -> None:
    d = sphere(count)
    assert d.shape == (count, 3) and np.allclose(np.linalg.norm(d, axis=1), 1.0)
    assert np.linalg.norm(d.mean(axis=0)) < 2.0 / np.sqrt(count)


@quickly
@given(arrays((6, 3)), rotations(), rotations(), arrays(3))
def test_images_stay_when_world_and_camera_move_together(
    X: np.ndarray, R: np.ndarray, turn: np.ndarray, shift: np.ndarray
) -> None:
    uv, depth = project(X, K, R, BEFORE)
    np.testing.assert_allclose(K @ (R @ X.T + BEFORE[:, None]) / depth, np.vstack([uv.T, np.ones(6)]), atol=1e-9)
    moved = X @ turn.T + shift
    again, far = project(moved, K, R @ turn.T, BEFORE - R @ turn.T @ shift)
    np.testing.assert_allclose(again, uv, atol=1e-8)
    np.testing.assert_allclose(far, depth, atol=1e-8)


@quickly
@given(arrays((6, 3)), rotations(), arrays(3, 5.0))
def test_points_lie_on_the_lines_that_the_other_view_says(X: np.ndarray, R: np.ndarray, aside: np.ndarray) -> None:
    poses = (np.eye(3), BEFORE), (R, BEFORE + aside + [7.0, 0.0, 0.0])
    x, y = (np.column_stack([project(X, K, *pose)[0], np.ones(6)]) for pose in poses)
    F = fundamental((K, K), (poses[0][0], poses[1][0]), (poses[0][1], poses[1][1]))
    assert sampson(F, x, y).max() < 1e-6
    np.testing.assert_allclose(sampson(F.T, y, x), sampson(F, x, y), atol=1e-9)


@quickly
@given(numbers(-2.0, 2.0), numbers(-2.0, 2.0), numbers(-5.0, 5.0), arrays((8, 2), 9.0))
def test_between_pixels_a_plane_is_a_plane(a: float, b: float, c: float, aside: np.ndarray) -> None:
    rows, columns = np.mgrid[:40, :50].astype(np.float32)
    at = aside + 20.0
    found = bilinear((a * columns + b * rows + c).astype(np.float32), at)
    # OpenCV interpolates in steps of 1/32 pixel
    np.testing.assert_allclose(found, a * at[:, 0] + b * at[:, 1] + c, atol=0.15)


@quickly
@given(numbers(-0.5, 0.5), st.floats(0.01, 10.0), numbers(-5.0, 5.0))
def test_the_peak_of_a_parabola_is_found(top: float, bow: float, high: float) -> None:
    left, middle, right = (np.array(high - bow * (k - top) ** 2) for k in (-1, 0, 1))
    assert np.isclose(peak(left, middle, right), top, atol=1e-6)
    assert peak(left, left, left) == 0.0


@quickly
@given(arrays((3, 3), 9.0), rotations())
def test_a_triangle_is_drawn_within_its_corners_at_depths_between_theirs(X: np.ndarray, R: np.ndarray) -> None:
    uv, depth = project(X, K, R, BEFORE)
    drawn, face = rasterise(X, np.array([[0, 1, 2]]), K, R, BEFORE, (64, 48))
    rows, columns = np.nonzero(face == 0)
    assert np.array_equal(np.isfinite(drawn), face == 0)
    for at, corner in ((columns, uv[:, 0]), (rows, uv[:, 1])):
        assert np.all((at >= corner.min() - 1e-9) & (at <= corner.max() + 1e-9))
    seen = drawn[rows, columns]
    assert np.all((seen >= depth.min() - 1e-9) & (seen <= depth.max() + 1e-9))
    turned_over = rasterise(X, np.array([[0, 2, 1]]), K, R, BEFORE, (64, 48))[1]
    assert np.count_nonzero(turned_over != face) <= 2, "but for centres of pixels on an edge"


@quickly
@given(arrays((6, 3)), arrays((6, 3), 1.0), rotations())
def test_of_a_surface_and_its_other_side_one_faces_the_camera(X: np.ndarray, n: np.ndarray, R: np.ndarray) -> None:
    front, back = (facing_points(X, side, K, R, BEFORE) for side in (n, -n))
    square_on = np.abs(np.sum((n @ R.T) * (X @ R.T + BEFORE), axis=1)) < 1e-9
    assert len(front) + len(back) == 6 - np.count_nonzero(square_on) or square_on.any()
    uv, depth = project(X, K, R, BEFORE)
    for row in np.vstack([front, back]):
        assert np.abs(np.column_stack([uv, depth]) - row).max(axis=1).min() < 1e-9
