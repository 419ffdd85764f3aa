"""Near and far of a small body far away: the model that fits better is kept."""

from dataclasses import replace

import numpy as np
import pytest
import scene
import test_mapping

from massprops.sfm.convert import to_points, to_views
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.points import project, residuals
from massprops.sfm.reversed_depth import depth_reversal_resolved, reversed_in_depth


def filmed(tmp_path, distance):
    """The model of ten images, 8 degrees apart, of points within 1 of the middle, and the truth."""
    from massprops.sfm.database import write_database
    from massprops.sfm.mapping import map_images, match, quiet

    quiet()
    views, points = scene.make(10, 150, focal=110.0 * distance, seed=2)
    views = replace(views, t=np.tile([0.05, -0.02, distance], (10, 1)))
    v, p = points.obs_view, points.obs_point
    uv = project(views.K[v], views.distortion[v], views.R[v], views.t[v], points.xyz[p])
    points = replace(points, obs_uv=uv + 0.1 * np.random.default_rng(3).standard_normal(uv.shape))
    given = {"focal_px": 110.0 * distance, "focal_source": "given"}
    write_database(tmp_path / "database.db", test_mapping.footage(views, **given), test_mapping.features(views, points))
    mapping = MappingOptions(masked=True, fixed_intrinsics=True, threads=1)
    names = views.names
    match(tmp_path / "database.db", [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]], mapping)
    return map_images(tmp_path / "database.db", tmp_path, tmp_path / "models", mapping, 10)[0], views, mapping


def error(model, truth):
    return test_mapping.attitude_error(to_views(model)[0], truth)


def test_a_model_or_its_reverse_ends_in_the_right_one(tmp_path):
    model, truth, mapping = filmed(tmp_path, 10.0)
    other = reversed_in_depth(model)
    assert sorted([error(model, truth) < 0.01, error(other, truth) < 0.01]) == [False, True]
    for start in (model, other):
        assert error(depth_reversal_resolved(start, mapping), truth) < 0.01


def test_from_very_far_away_the_reverse_shows_the_same(tmp_path):
    model, _, _ = filmed(tmp_path, 10.0)
    before = [to_views(model)[0].R[0], len(model.points3D)]
    other = reversed_in_depth(reversed_in_depth(model))
    views, ids = to_views(other)
    np.testing.assert_allclose(views.R[0], before[0], atol=1e-9)
    away = np.linalg.norm(residuals(views, to_points(other, ids)), axis=1)
    assert np.median(away) == pytest.approx(np.median(np.linalg.norm(residuals(*_arrays(model)), axis=1)), abs=0.01)
    # the same images but for perspective: the body is a tenth as deep as it is far
    away = np.linalg.norm(residuals(*_arrays(reversed_in_depth(model))), axis=1)
    assert 1.0 < np.median(away) < 0.15 * 110


def _arrays(model):
    views, ids = to_views(model)
    return views, to_points(model, ids)
