"""Where a body is, from its silhouettes alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from massprops.errors import NotPossible
from massprops.surface.outline_cloud import ball_of_outlines
from massprops.views import Views

MIDDLE, RADIUS = np.array([0.3, -0.2, 0.5]), 0.4


def ball_views(n=12, step_deg=25.0):
    """Views of a ball and its silhouettes; the first image does not show it."""
    R = (
        Rotation.from_euler("y", np.arange(n)[:, None] * step_deg, degrees=True) * Rotation.from_euler("x", 30, True)
    ).as_matrix()
    t = np.tile([0.1, 0.05, 6.0], (n, 1)) - np.einsum("nij,j->ni", R, MIDDLE)
    K = np.tile(np.array([[300.0, 0, 99.5], [0, 300.0, 79.5], [0, 0, 1]]), (n, 1, 1))
    names = tuple(f"cam0/{i}.png" for i in range(n))
    views = Views(names, np.full(n, -1), np.tile([200, 160], (n, 1)), K, np.zeros((n, 4)), R, t)
    v, u = np.mgrid[:160, :200]
    ray = np.stack([(u - 99.5) / 300, (v - 79.5) / 300, np.ones(u.shape)], -1)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    masks = []
    for i in range(n):
        c = R[i] @ MIDDLE + t[i]
        off = np.linalg.norm(c - (ray @ c)[..., None] * ray, axis=2)
        masks.append(np.where(off < RADIUS, 255, 0).astype(np.uint8))
    masks[0][:] = 0
    return views, masks


def test_a_ball_is_found_by_its_outlines():
    middle, radius = ball_of_outlines(*ball_views())
    np.testing.assert_allclose(middle, MIDDLE, atol=0.01)
    assert radius == pytest.approx(RADIUS, rel=0.05)


def test_one_side_bounds_no_body():
    with pytest.raises(NotPossible, match="one side"):
        ball_of_outlines(*ball_views(step_deg=0.0))


def test_too_few_outlines_say_nothing():
    views, masks = ball_views()
    with pytest.raises(NotPossible, match="2 silhouettes"):
        ball_of_outlines(views, [*masks[1:3], *(np.zeros_like(m) for m in masks[2:])][: len(views)])


def test_poses_the_wrong_way_round_are_named():
    views, masks = ball_views()
    with pytest.raises(NotPossible, match="behind"):
        ball_of_outlines(
            Views(views.names, views.timestamp_ns, views.size, views.K, views.distortion, views.R, -views.t), masks
        )
