"""Photographs added to a model, and those whose matches speak against their place."""

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
import test_mapping

from massprops.sfm.attempt import SfmOptions, _first_pairs
from massprops.sfm.database import drop_pairs
from massprops.sfm.left_out_images import (
    _pairs_of,
    agreeing_matches,
    take_out_contradicted,
    take_out_unmatched,
    take_out_unsupported,
)
from massprops.sfm.loops import forget
from massprops.sfm.match_parts import put_back, taken


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("extend") / "solved"
    model, *_ = test_mapping.solve(folder)
    return model, folder / "database.db"


def test_an_image_in_its_place_stays_and_one_elsewhere_goes(solved):
    model, database = pycolmap.Reconstruction(solved[0]), solved[1]
    ids = sorted(model.reg_image_ids())
    last = ids[-1]
    agree, all_of = agreeing_matches(model, database, set(ids[:-1]))[last]
    assert agree > 0.95 * all_of > 100
    take_out_contradicted(model, database, set(ids[:-1]))
    assert sorted(model.reg_image_ids()) == ids
    # moved by a tenth of its distance, as an image that a pattern has placed one cell further on
    frame = model.frame(model.image(last).frame_id)
    pose = np.asarray(frame.rig_from_world.matrix()).copy()
    pose[1, 3] += 0.1 * pose[2, 3]
    frame.rig_from_world = pycolmap.Rigid3d(pose)
    assert agreeing_matches(model, database, set(ids[:-1]))[last][0] < 0.3 * all_of
    take_out_contradicted(model, database, set(ids[:-1]))
    assert sorted(model.reg_image_ids()) == ids[:-1]


def test_each_image_that_is_borne_out_judges_the_next(solved):
    model, database = pycolmap.Reconstruction(solved[0]), solved[1]
    ids = sorted(model.reg_image_ids())
    take_out_unsupported(model, database, set(ids[:4]))
    assert sorted(model.reg_image_ids()) == ids
    for last in ids[-2:]:  # a tenth of the distance off, both alike: their own matches agree
        frame = model.frame(model.image(last).frame_id)
        pose = np.asarray(frame.rig_from_world.matrix()).copy()
        pose[1, 3] += 0.1 * pose[2, 3]
        frame.rig_from_world = pycolmap.Rigid3d(pose)
    take_out_unsupported(model, database, set(ids[:4]))
    assert sorted(model.reg_image_ids()) == ids[:-2]


def test_pairs_that_contradict_a_model_are_counted(solved):
    """An image a tenth of its distance off: all that it shares with others contradicts its place."""
    from massprops.sfm.contradictions import contradictions

    model, database = pycolmap.Reconstruction(solved[0]), solved[1]
    right = contradictions(model, database)
    assert right.share < 0.02 and not right.said({})
    names = sorted(model.image(i).name for i in model.reg_image_ids())
    for last in sorted(model.reg_image_ids())[-len(names) // 3 :]:
        frame = model.frame(model.image(last).frame_id)
        pose = np.asarray(frame.rig_from_world.matrix()).copy()
        pose[1, 3] += 0.1 * pose[2, 3] * (1 + last % 3)
        frame.rig_from_world = pycolmap.Rigid3d(pose)
    wrong = contradictions(model, database)
    (said,) = wrong.said({wrong.pairs[0][0]: "IMG 7.jpg"})
    assert wrong.share > 0.3 and "IMG 7.jpg" in said and wrong.pairs[0][1] in said


def test_an_image_that_sees_little_of_what_is_before_it_goes(solved):
    model = pycolmap.Reconstruction(solved[0])
    ids = sorted(model.reg_image_ids())
    names = {model.image(i).name for i in ids[-2:]}
    take_out_unmatched(model, names)
    assert sorted(model.reg_image_ids()) == ids
    for k, feature in enumerate(list(model.image(ids[-1]).points2D)):
        if feature.has_point3D() and model.image(ids[-1]).num_points3D > 8:
            model.delete_observation(ids[-1], k)
    take_out_unmatched(model, names)
    assert sorted(model.reg_image_ids()) == ids[:-1]


def test_matches_with_images_that_are_not_placed_are_kept(solved, tmp_path):
    database = tmp_path / "copy.db"
    database.write_bytes(solved[1].read_bytes())
    ids = sorted(solved[0].reg_image_ids())

    def pairs():
        with pycolmap.Database.open(database) as db:
            return {pycolmap.pair_id_to_image_pair(p) for p in db.read_all_matches()[0]}

    before = pairs()
    forget(database, ids[:-1], {ids[0]})
    gone = {p for p in before if ids[0] in p and ids[-1] not in p}
    assert pairs() == before - gone and len(gone) == len(ids) - 2
    forget(database, ids[:-1], set(ids))
    assert pairs() == {p for p in before if ids[-1] in p} != set()


def test_pairs_that_were_compared_in_vain_can_be_matched_anew(solved, tmp_path):
    """COLMAP keeps a row without matches of each, which none of its lists names."""
    database = tmp_path / "copy.db"
    database.write_bytes(solved[1].read_bytes())
    a, b = sorted(solved[0].reg_image_ids())[:2]
    with pycolmap.Database.open(database) as db:
        db.delete_matches(a, b)
        db.write_matches(a, b, np.zeros((0, 2), np.uint32))
        assert pycolmap.image_pair_to_pair_id(a, b) not in db.read_all_matches()[0]
    forget(database, [a, b], {a})
    with pycolmap.Database.open(database) as db:
        db.write_matches(a, b, np.array([[0, 1]], np.uint32))
        assert db.exists_matches(a, b)


def test_an_image_gets_its_own_matches_back(solved, tmp_path):
    database = tmp_path / "copy.db"
    database.write_bytes(solved[1].read_bytes())

    def matches():
        with pycolmap.Database.open(database) as db:
            return {p: np.asarray(m).tolist() for p, m in zip(*db.read_all_matches(), strict=True)}

    before = matches()
    rows = taken(database, _pairs_of(database, {3})[3])
    with pycolmap.Database.open(database) as db:
        db.delete_matches(1, 3)
        db.write_matches(1, 3, np.array([[0, 1], [1, 0]], np.uint32))
        db.delete_matches(3, 4)
    assert matches() != before
    drop_pairs(database, map(pycolmap.pair_id_to_image_pair, _pairs_of(database, {3})[3]))
    put_back(database, rows)
    assert matches() == before


def test_photographs_of_a_pattern_are_compared_with_all_others():
    names = [f"cam0/{i:06d}.png" for i in range(20)]
    views = type("V", (), {"names": names, "timestamp_ns": np.arange(20)})
    video = test_mapping.footage(views)
    photographs = replace(video, kind="images")
    none = [np.zeros((0, 128), np.uint8)] * 20
    few = _first_pairs(video, names, none, SfmOptions(), True, False)
    every = _first_pairs(photographs, names, none, SfmOptions(), True, False)
    assert len(few) < 100 and len(every) == 190
    assert len(_first_pairs(photographs, names, none, SfmOptions(), False, False)) < 190
