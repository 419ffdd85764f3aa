"""A textured plane seen from 35 degrees on either side: its patches are found where they are, and features too."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import scene
from scipy.spatial.transform import Rotation

from massprops.sfm.distinct import unit
from massprops.sfm.feature_candidates import feature_candidates
from massprops.sfm.oblique_patches import patch_candidates
from massprops.sfm.points import project


def plane(seed=0):
    """Four views, two from either side, of points on a plane, with the images."""
    views, points = scene.make(4, 300, focal=1200.0, seed=seed)
    R = Rotation.from_euler("y", np.array([[-38], [-32], [32], [38]]), degrees=True).as_matrix()
    views = replace(views, R=R)
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-0.8, 0.8, (300, 2)), np.zeros(300)])
    v, p = points.obs_view, points.obs_point
    points = replace(points, xyz=xyz, obs_uv=project(views.K[v], views.distortion[v], views.R[v], views.t[v], xyz[p]))
    texture = cv2.GaussianBlur(rng.standard_normal((800, 800)).astype(np.float32), (0, 0), 3.0)
    texture = 120 + 40 * texture / texture.std()
    images = []
    for i in range(4):
        # texture pixels to the plane to the image
        to_plane = np.array([[2 / 800, 0, -1], [0, 2 / 800, -1], [0, 0, 1.0]])
        H = views.K[i] @ np.column_stack([views.R[i][:, 0], views.R[i][:, 1], views.t[i]]) @ to_plane
        images.append(np.clip(cv2.warpPerspective(texture, H, (640, 480)), 0, 255))
    return views, points.observed(v < 2), images


@pytest.mark.parametrize("off", [0.0, 0.6])
def test_patches_are_found_where_they_are(off):
    views, points, images = plane()
    true = points.xyz
    # the second model is thought to lie elsewhere, by 5 px
    turned = Rotation.from_euler("xyz", [off, off, off], degrees=True).as_matrix()
    R = views.R.copy()
    R[2:] = turned @ R[2:]
    found = patch_candidates(replace(views, R=R), points, np.arange(4) < 2, 20, lambda i: images[i])
    assert len(found.point) > 300
    v = found.view
    at = project(views.K[v], views.distortion[v], views.R[v], views.t[v], true[found.point])
    away = np.linalg.norm(at - found.uv, axis=1)
    assert np.median(away) < 0.3
    assert np.mean(away < 1.0) > 0.9


def test_an_image_of_something_else_has_none_in_common():
    views, points, images = plane()
    images[2:] = plane(seed=1)[2][2:]
    found = patch_candidates(views, points, np.arange(4) < 2, 20, lambda i: images[i])
    v = found.view
    at = project(views.K[v], views.distortion[v], views.R[v], views.t[v], points.xyz[found.point])
    assert np.mean(np.linalg.norm(at - found.uv, axis=1) < 1.0) < 0.05


def test_features_are_looked_for_near_their_place_only():
    views, points, _ = plane()
    rng = np.random.default_rng(3)
    words = unit(rng.uniform(0, 255, (300, 128)) * (rng.random((300, 128)) < 0.2))
    every = np.arange(300)
    places = [
        project(
            *(np.tile(a[i], (300, *[1] * a[i].ndim)) for a in (views.K, views.distortion, views.R, views.t)), points.xyz
        )
        for i in range(4)
    ]
    features = [(at, words) for at in places]
    # half of the features of the second model look like points far away
    swapped = np.where(every % 2, every, np.roll(every, 150))
    features[2] = features[3] = (places[2][swapped], words)
    features[3] = (places[3][swapped], words)
    found = feature_candidates(views, points, np.arange(4) < 2, 6, words[points.obs_point], features)
    assert set(found.view.tolist()) == {2, 3}
    at = np.array([places[v][p] for p, v in zip(found.point, found.view, strict=True)])
    np.testing.assert_allclose(found.uv, at, atol=6)
    assert np.mean(found.point % 2) > 0.95
    assert len(np.unique(found.point[found.point % 2 == 1])) == 150
