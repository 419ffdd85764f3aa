"""Models of a tumbling body that share no image are joined by their motion and what both show, or not at all."""

from dataclasses import replace

import numpy as np
import pytest
import scene
import test_mapping
from test_free_motion import tumbling

from massprops.sfm import best_attempt, grown_film, joined_pieces, reconstruct
from massprops.sfm.assembled import STAYS, Part, Sighting, Similarity, assemble
from massprops.sfm.attempt import Attempt, ModelInputs, SfmOptions
from massprops.sfm.consensus import Candidates
from massprops.sfm.convert import to_points, to_views
from massprops.sfm.joined_pieces import join_pieces
from massprops.sfm.points import project, residuals

NOTHING = Candidates(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)))


def filmed(which, R):
    """Views of a cloud of points at attitudes R, of the frames `which`."""
    views, points = scene.make(len(which), 160, seed=5)
    views = replace(views, R=R[which], t=views.t + [0.0, 0.0, 2.0], timestamp_ns=np.array(which) * 10**9)
    v, p = points.obs_view, points.obs_point
    uv = project(views.K[v], views.distortion[v], views.R[v], views.t[v], points.xyz[p])
    return views, replace(points, obs_uv=uv + 0.1 * np.random.default_rng(6).standard_normal(uv.shape))


def pieces(folder, R, strange=False, which=(*range(9), *range(18, 27))):
    """What matching within two pieces of nine images comes to, ten frames apart; or within one, of the frames `which`.

    Args:
        strange: no feature of the second looks like any of the first.
    """
    from massprops.sfm.database import write_database
    from massprops.sfm.mapping import MappingOptions, map_images, match, quiet

    quiet()
    (folder / "frames").mkdir(parents=True)
    views, points = filmed([*which], R)
    whole, n = which[-1] == len(which) - 1, len(which)
    footage = test_mapping.footage(views, folder)
    found, other = test_mapping.features(views, points), test_mapping.features(views, points, 1)
    if strange:
        found = {n: (other if i >= 9 else found)[n] for i, n in enumerate(views.names)}
    database, names = folder / "database.db", views.names
    write_database(database, footage, found)
    mapping = MappingOptions(masked=True, threads=1)
    together = [(i, j) for i in range(n) for j in range(i + 1, n) if whole or (i < 9) == (j < 9)]
    match(database, [(names[i], names[j]) for i, j in together], mapping)
    models = map_images(database, folder, folder / "models", mapping, n)
    attempted = Attempt(database, mapping, models, found, lambda pairs: None, False, False, [])
    return ModelInputs(attempted, footage, SfmOptions(threads=1), folder / "work"), views


@pytest.fixture(autouse=True)
def no_images(monkeypatch):
    """Nothing is rendered: features alone are looked for."""
    monkeypatch.setattr(joined_pieces, "patch_candidates", lambda *rest: NOTHING)


def test_two_pieces_are_joined_where_the_truth_has_them(tmp_path):
    given, truth = pieces(tmp_path / "a", tumbling())
    models = given.found.models
    assert [m.num_reg_images() for m in models] == [9, 9]
    joined = join_pieces(models[0], models[1:], given)
    views, _ = to_views(joined)
    assert views.names == truth.names
    assert test_mapping.attitude_error(views, truth) < 0.005


def test_images_that_the_adjustment_takes_out_are_not_missed(tmp_path, monkeypatch):
    """Two of the second piece go, and with four more there are too few left to tell its motion."""
    import pycolmap

    adjusted = joined_pieces._adjust
    for lost, left in ((2, 16), (6, 9)):
        given, _ = pieces(tmp_path / str(lost), tumbling())
        first, second = given.found.models
        gone = sorted(second.reg_image_ids())[:lost]

        def lossy(model, given, gone=gone):
            adjusted(model, given)
            for i in set(gone) & set(model.reg_image_ids()):
                pycolmap.ObservationManager(model).deregister_frame(model.image(i).frame_id)

        monkeypatch.setattr(joined_pieces, "_adjust", lossy)
        assert join_pieces(first, [second], given).num_reg_images() == left


def test_pieces_that_show_nothing_in_common_stay_apart(tmp_path):
    given, _ = pieces(tmp_path / "b", tumbling(), strange=True)
    assert join_pieces(given.found.models[0], given.found.models[1:], given).num_reg_images() == 9


def test_pieces_without_a_free_motion_in_common_stay_apart(tmp_path):
    R = tumbling()
    R[18:] = R[18:][::-1]
    given, _ = pieces(tmp_path / "c", R)
    assert join_pieces(given.found.models[0], given.found.models[1:], given).num_reg_images() == 9


def test_a_model_put_together_sees_its_points_where_they_were_seen(tmp_path):
    given, _ = pieces(tmp_path / "d", tumbling())
    first, second = given.found.models
    ids = [frozenset(m.reg_image_ids()) for m in (first, second)]
    turn = tumbling()[7]
    point = min(second.point3D_ids())
    seen = Sighting(1, point, min(ids[0]), np.array([12.0, 34.0]))
    both = assemble(
        [Part(first, ids[0], STAYS), Part(second, ids[1], Similarity(0.3, turn, np.array([1.0, 2, 3])))], [seen]
    )
    views, numbers = to_views(both)
    points = to_points(both, numbers)
    assert len(views) == 18 and len(points.xyz) == first.num_points3D() + second.num_points3D()
    added = np.all(np.abs(points.obs_uv - [12.0, 34.0]) < 1e-6, axis=1)
    assert added.sum() == 1
    away = np.linalg.norm(residuals(views, points), axis=1)[~added]
    # the second model's focal length is the first's now
    assert np.median(away) < 0.5 and np.quantile(away, 0.99) < 5


def test_films_of_tumbling_bodies_are_joined_so_and_photographs_are_not(tmp_path, monkeypatch):
    given, _ = pieces(tmp_path / "e", tumbling())
    asked = []

    def last(model, *rest):
        raise StopIteration

    monkeypatch.setattr(best_attempt, "_best", lambda *rest: given.found)
    monkeypatch.setattr(reconstruct, "close_loops", lambda model, given: model)
    monkeypatch.setattr(reconstruct, "add_left_out_images", lambda model, given: model)
    monkeypatch.setattr(reconstruct, "join_models", lambda model, *rest: model)
    monkeypatch.setattr(reconstruct, "with_finer_features", lambda mapped: mapped)
    monkeypatch.setattr(reconstruct, "finish", last)
    monkeypatch.setattr(grown_film, "join_pieces", lambda model, apart, given: asked.append(len(apart)) or model)
    for kind, motion in (("video", "tumbling"), ("video", "static"), ("images", "tumbling")):
        with pytest.raises(StopIteration):
            reconstruct.reconstruct(
                replace(given.footage, kind=kind, motion=motion), tmp_path / kind / motion, SfmOptions(threads=1)
            )
    assert asked == [1]
