"""Views, sparse points and dense points carried into one frame."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix
from massprops.sfm.points import SparsePoints, project
from massprops.surface.cloud import Cloud
from massprops.views import Views

RNG = np.random.default_rng(0)
R = rotation_matrix(np.array([0.5, 0.5, -0.5, 0.5]))
T = np.array([0.3, -0.2, 0.1])


def views(n: int) -> Views:
    turned = np.stack([rotation_matrix(q / np.linalg.norm(q)) for q in RNG.standard_normal((n, 4))])
    K = np.tile(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), (n, 1, 1))
    shift = np.tile([0, 0, 9.0], (n, 1))
    names = tuple(f"cam0/{i}.png" for i in range(n))
    return Views(names, np.arange(n), np.tile([640, 480], (n, 1)), K, np.zeros((n, 4)), turned, shift)


def sparse() -> SparsePoints:
    m, k = 6, 12
    view, point = np.repeat([0, 1, 2], 4), np.tile([0, 1, 2, 3, 4, 5], 2)
    return SparsePoints(
        np.arange(m),
        RNG.standard_normal((m, 3)),
        np.zeros((m, 3), np.uint8),
        np.zeros(m),
        view,
        point,
        np.zeros((k, 2)),
    )


def test_moving_views_with_their_world_changes_no_image() -> None:
    before, xyz = views(3), RNG.standard_normal((3, 3))
    after = before.moved(R, T)
    pixels = [project(v.K, v.distortion, v.R, v.t, x) for v, x in ((before, xyz), (after, xyz @ R.T + T))]
    assert np.allclose(*pixels, atol=1e-9)
    assert len(Views.joined([before, after])) == 6


def test_points_keep_what_saw_them() -> None:
    points = sparse()
    part = points.of_views(np.array([2, 0]))
    assert set(part.obs_view) == {0, 1}
    whole = {(int(v), int(points.id[p])) for v, p in zip(points.obs_view, points.obs_point, strict=True) if v != 1}
    assert {([2, 0][v], int(part.id[p])) for v, p in zip(part.obs_view, part.obs_point, strict=True)} == whole
    both = SparsePoints.joined([points, part.moved(R, T, 3)])
    assert len(both.xyz) == 6 + len(part.xyz) and both.obs_view.max() == 4
    assert np.allclose(both.xyz[both.obs_point[12:]], (part.xyz @ R.T + T)[part.obs_point])


def test_a_cloud_loses_the_lines_of_sight_of_views_that_go() -> None:
    cloud = Cloud(np.eye(3), np.eye(3), np.ones(3), np.array([0, 2, 3, 5]), np.array([0, 1, 1, 2, 0]))
    kept = cloud.of_views(np.array([1, -1, 0]))
    assert np.array_equal(kept.xyz, np.eye(3)[[0, 2]]), "the second was seen by the view that went alone"
    assert [kept.view_index[a:b].tolist() for a, b in zip(kept.view_start, kept.view_start[1:], strict=False)] == [
        [1],
        [0, 1],
    ]
    both = Cloud.joined([kept, kept.moved(R, T, 5)])
    assert len(both) == 4 and both.view_index.tolist() == [1, 0, 1, 6, 5, 6]
