"""Photographs that hang together by themselves are joined to the largest model by a view that sees their side from afar."""

from dataclasses import replace

import numpy as np
import pytest
import scene
import test_mapping
from scipy.spatial.transform import Rotation

from massprops.sfm import joined_models
from massprops.sfm.attempt import Attempt, ModelInputs, SfmOptions
from massprops.sfm.convert import to_views
from massprops.sfm.joined_models import join_models, link
from massprops.sfm.points import project


def surface(m, seed):
    """Twelve views of m points on a bumpy surface."""
    views, points = scene.make(12, m, seed=seed)
    x, y = points.xyz[:, 0], points.xyz[:, 1]
    xyz = np.column_stack([x, y, 0.3 * np.sin(3 * x) + 0.3 * np.cos(2 * y)])
    v, p = points.obs_view, points.obs_point
    uv = project(views.K[v], views.distortion[v], views.R[v], views.t[v], xyz[p])
    return views, replace(points, xyz=xyz, obs_uv=uv)


def part(views, points, index, every, first):
    """The views at `index` with every so many of the points, from the first on."""
    index = np.array(index)
    own = points.observed(points.obs_point % every == first).of_views(index)
    return views.take(index), own


def test_a_view_in_both_models_tells_place_and_size():
    """They have no point in common: what lies beside each other in the view tells the size."""
    views, points = surface(1500, 1)
    larger = part(views, points, range(8), 2, 0)
    own, seen = part(views, points, range(7, 12), 2, 1)
    turn, move, size = Rotation.from_euler("xyz", [20, 40, -70], degrees=True).as_matrix(), np.array([1.0, 2, -3]), 0.4
    # the smaller model in a world of its own: y = size (turn x + move)
    R = own.R @ turn.T
    smaller = replace(own, R=R, t=size * (own.t - np.einsum("nij,j->ni", R, move)))
    found = link(larger, (smaller, replace(seen, xyz=size * (seen.xyz @ turn.T + move))))
    assert found is not None and len(found.ratios) > 100
    assert abs(found.scale * size - 1) < 2e-3
    np.testing.assert_allclose(found.R, turn.T, atol=1e-9)
    back = found.scale * (size * (points.xyz @ turn.T + move)) @ found.R.T + found.t
    assert np.abs(back - points.xyz).max() < 0.02  # of distances of 8 that the size scales


def test_distances_that_do_not_tell_the_size_join_nothing():
    views, points = scene.make(12, 140, seed=2)  # not a surface: what is beside each other is not equally far
    larger, smaller = part(views, points, range(8), 2, 0), part(views, points, range(7, 12), 2, 1)
    assert link(larger, smaller) is None
    views, points = surface(1500, 1)
    assert link(part(views, points, range(7), 2, 0), part(views, points, range(7, 12), 2, 1)) is None


def split(folder, shared, monkeypatch):
    """Two models of twelve images, of which only every `shared`-th usual feature is alike across; all fainter ones are."""
    from massprops.sfm.database import write_database
    from massprops.sfm.mapping import MappingOptions, map_images, match, quiet

    quiet()
    (folder / "frames").mkdir(parents=True)
    views, points = surface(240, 3)
    noise = np.random.default_rng(4).normal(size=points.obs_uv.shape)
    points = replace(points, obs_uv=points.obs_uv + 0.05 * noise)
    footage = replace(test_mapping.footage(views, folder), kind="images", motion="static", background="moving")
    every, others = test_mapping.features(views, points, 0), test_mapping.features(views, points, 1)
    usual = {}
    for i, name in enumerate(views.names):
        words = every[name][1].copy()
        if i >= 7:
            strange = np.arange(len(words)) % shared > 0
            words[strange] = others[name][1][strange]
        usual[name] = (every[name][0], words)
    database, names = folder / "database.db", views.names
    write_database(database, footage, usual)
    mapping = MappingOptions(masked=True, threads=1)
    match(database, [(names[i], names[j]) for i in range(12) for j in range(i + 1, 12)], mapping)
    models = map_images(database, folder, folder / "models", mapping, 12)
    found = Attempt(database, mapping, models, usual, lambda pairs: None, False, False, [])
    monkeypatch.setattr(joined_models, "extract_all", lambda *rest: (every, []))
    return ModelInputs(found, footage, SfmOptions(threads=1), folder / "work"), views


def test_a_model_apart_is_joined_where_the_truth_has_it(tmp_path, monkeypatch):
    given, truth = split(tmp_path / "a", 10, monkeypatch)
    models = given.found.models
    assert sorted(m.num_reg_images() for m in models) == [5, 7]
    joined = join_models(models[0], models[1:], given)
    views, _ = to_views(joined)
    assert views.names == truth.names
    assert test_mapping.attitude_error(views, truth) < 0.01


def test_what_matches_nothing_where_it_is_put_is_not_joined(tmp_path, monkeypatch):
    given, _ = split(tmp_path / "b", 400, monkeypatch)
    models = given.found.models
    assert join_models(models[0], models[1:], given).num_reg_images() == 7


def test_photographs_are_joined_and_frames_of_a_video_are_not(tmp_path, monkeypatch):
    from massprops.sfm import best_attempt, reconstruct

    given, _ = split(tmp_path / "c", 10, monkeypatch)
    asked = []

    def last(model, *rest):
        raise StopIteration

    monkeypatch.setattr(best_attempt, "_best", lambda *rest: given.found)
    monkeypatch.setattr(reconstruct, "close_loops", lambda model, given: model)
    monkeypatch.setattr(reconstruct, "add_left_out_images", lambda model, given: model)
    monkeypatch.setattr(reconstruct, "finish", last)
    monkeypatch.setattr(reconstruct, "join_models", lambda model, apart, given: asked.append(len(apart)) or model)
    for kind in ("images", "video"):
        with pytest.raises(StopIteration):
            reconstruct.reconstruct(replace(given.footage, kind=kind), tmp_path / kind, SfmOptions(threads=1))
    assert asked == [1]
