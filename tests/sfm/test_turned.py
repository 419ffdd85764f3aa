"""Photographs on their side: one camera for all, and a model that fits the images as they are shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scene
from test_mapping import attitude_error, features

from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord
from massprops.sfm.points import project_camera, residuals


def held(views, turns, cameras, camera):
    frames = tuple(FrameRecord(n, camera[i], -1, i, turn=turns[i]) for i, n in enumerate(views.names))
    return FootageRecord(Path(), "", "images", "static", "moving", False, cameras, frames)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("model", "terms"), [("OPENCV", (-0.1, 0.02, 3e-3, -2e-3)), ("OPENCV_FISHEYE", (-0.03, 0.01, 0.0, 0.0))]
)
def test_a_turned_camera_sees_the_turned_points(turn, model, terms):
    import pycolmap

    from massprops.sfm.convert import opencv_camera
    from massprops.sfm.turned import QUARTER, turn_camera, turn_points

    camera = pycolmap.Camera(camera_id=1, model=model, width=640, height=480, params=[500, 520, 310, 250, *terms])
    c = np.random.default_rng(0).uniform([-1, -1, 3], [1, 1, 5], (50, 3))

    def seen(camera, c):
        K, distortion = opencv_camera(camera)
        return project_camera(np.tile(K, (50, 1, 1)), np.tile(distortion, (50, 1)), c) + 0.5

    turned = turn_camera(camera, turn, 2)
    expected = turn_points(seen(camera, c), (640, 480), turn)
    np.testing.assert_allclose(seen(turned, c @ np.linalg.matrix_power(QUARTER, turn).T), expected, atol=1e-9)


def test_the_points_turn_with_the_pixels():
    from massprops.sfm.turned import turn_image, turn_points

    image = np.zeros((48, 64), np.uint8)
    image[5, 20] = 255
    for turn in range(4):
        ((y, x),) = np.argwhere(turn_image(image, turn))
        np.testing.assert_array_equal(turn_points(np.array([[20.5, 5.5]]), (64, 48), turn), [[x + 0.5, y + 0.5]])


def test_sideways_and_zoomed_images_in_one_model(tmp_path):
    """Twelve images of one phone, four of them on their side, and four through a longer lens."""
    from massprops.sfm.convert import HALF, to_points, to_views
    from massprops.sfm.database import write_database
    from massprops.sfm.mapping import MappingOptions, map_images, match, quiet
    from massprops.sfm.refine import RefineOptions, refine
    from massprops.sfm.turned import turn_keypoints, turn_points, upright

    quiet()
    views, points = scene.make(12, 120, focal=820.0, noise=0.05, step_deg=8)
    longer = np.array([i % 3 == 2 for i in range(12)])
    K = views.K.copy()
    K[longer, 0, 0] = K[longer, 1, 1] = 1100.0
    v = points.obs_view
    uv = points.obs_uv.copy()
    uv[longer[v]] = (uv[longer[v]] - [319.5, 239.5]) * 1100.0 / 820.0 + [319.5, 239.5]
    views, points = replace(views, K=K), replace(points, obs_uv=uv)
    turns = [{1: 1, 4: 3, 7: 2}.get(i, 0) for i in range(12)]
    footage = held(
        views, turns, (CameraRecord(0, (640, 480)), CameraRecord(1, (640, 480), 1000.0)), longer.astype(int).tolist()
    )
    # the images as shown: those that the footage turns were stored turned the other way
    found = features(views, points)
    database = tmp_path / "database.db"
    write_database(database, footage, found)
    options = MappingOptions(masked=True, threads=1)
    match(database, [(views.names[i], views.names[j]) for i in range(12) for j in range(i + 1, 12)], options)
    model = map_images(database, tmp_path, tmp_path / "models", options, 12)[0]
    accuracy = refine(model, RefineOptions(), True, False, 1).precision
    solved, _ = to_views(model)
    assert len(solved) == 12 and len(model.cameras) == 2
    focal = solved.K[:, 0, 0]
    assert len(set(focal[longer])) == len(set(focal[~longer])) == 1
    assert focal == pytest.approx(views.K[:, 0, 0], rel=max(0.005, 3 * accuracy.focal_relative))
    assert attitude_error(solved, views) < 5e-3

    shown = upright(model, footage)
    out, ids = to_views(shown)
    own = to_points(shown, ids)
    before = to_points(model, ids)
    assert out.names == solved.names and len(own.xyz) == len(before.xyz) and len(own.obs_uv) == len(before.obs_uv)
    assert (
        np.abs(np.linalg.norm(residuals(out, own), axis=1) - np.linalg.norm(residuals(solved, before), axis=1)).max()
        < 1e-9
    )
    for i, turn in enumerate(turns):
        assert tuple(out.size[i]) == ((480, 640) if turn % 2 else (640, 480))
        np.testing.assert_allclose(out.centres[i], solved.centres[i], atol=1e-9)
        mine = turn_points(own.obs_uv[own.obs_view == i] + HALF, tuple(out.size[i]), turn) - HALF
        np.testing.assert_allclose(mine, before.obs_uv[before.obs_view == i], atol=1e-9)
        keypoints = np.column_stack([own.obs_uv[own.obs_view == i] + HALF, np.ones((len(mine), 2))])
        back = turn_keypoints(keypoints, tuple(out.size[i]), turn)[:, :2] - HALF
        np.testing.assert_allclose(back, mine, atol=1e-9)
