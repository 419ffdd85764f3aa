"""Points as a pinhole camera sees them."""

import numpy as np

from massprops.geometry.facing import facing_points
from massprops.geometry.projection import project


def test_points_that_look_at_the_camera_are_projected_in_their_order():
    rng = np.random.default_rng(3)
    points, normals = rng.standard_normal((400, 3)).astype(np.float32), rng.standard_normal((400, 3)).astype(np.float32)
    K = np.array([[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]])
    R, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    t = np.array([0.1, -0.2, 0.7])
    uv, depth = project(points, K, R, t)
    shown = (depth > 0) & (np.einsum("ij,ij->i", normals, -R.T @ t - points) > 0)
    assert 20 < np.count_nonzero(shown) < 200
    np.testing.assert_allclose(facing_points(points, normals, K, R, t), np.column_stack([uv, depth])[shown], atol=1e-9)
