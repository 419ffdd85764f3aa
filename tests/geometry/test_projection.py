"""Points on the pixels of one view, against every point worked out by itself."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from massprops.geometry.projection import on_pixels, pixels_of

K = np.array([[80.0, 0, 31.5], [0, 90.0, 23.5], [0, 0, 1]])
SHAPE = (48, 64)


def one_by_one(xyz: np.ndarray, R: np.ndarray, t: np.ndarray) -> list[tuple[int, int, int]]:
    """Number, row and column of each point that is before the camera and in the image."""
    out = []
    for k, x in enumerate(xyz):
        camera = R @ x + t
        if camera[2] <= 0:
            continue
        u, v, _ = K @ camera / camera[2]
        row, column = round(v), round(u)
        if 0 <= row < SHAPE[0] and 0 <= column < SHAPE[1]:
            out.append((k, row, column))
    return out


def test_pixels_of_points_are_those_of_each_point_alone():
    rng = np.random.default_rng(3)
    xyz = 3.0 * rng.standard_normal((500, 3))
    R, t = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), np.array([0.2, 0.1, 2.0])
    found = list(zip(*(a.tolist() for a in pixels_of(xyz, K, R, t, SHAPE)), strict=True))
    assert found == one_by_one(xyz, R, t)
    assert 20 < len(found) < 400


def test_a_pixel_reaches_half_a_pixel_about_its_centre():
    uv = np.array([[-0.4, 0.0], [-0.6, 0.0], [63.4, 47.4], [63.6, 0.0], [0.0, 47.6], [1e30, 0.0], [12.4, 7.6]])
    index, rows, columns = on_pixels(uv, (*SHAPE, 3))
    assert index.tolist() == [0, 2, 6]
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == [(0, 0), (47, 63), (8, 12)]


def test_no_point_is_on_no_pixel():
    assert all(len(a) == 0 for a in pixels_of(np.zeros((0, 3)), K, np.eye(3), np.zeros(3), SHAPE))
