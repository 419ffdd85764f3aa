"""A flying body's film is mapped from several starts, as long as none convinces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation
from test_free_motion import tumbling
from test_joined_pieces import pieces

from massprops.errors import NotPossible
from massprops.sfm.along_motion import Following
from massprops.sfm.convert import take_out_images
from massprops.sfm.film_starts import STARTS, MappedFootage, best_start
from massprops.sfm.footage import CameraRecord, FootageRecord

FILM = FootageRecord(Path("x"), "x.mp4", "video", "tumbling", "black", True, (CameraRecord(0, (720, 540)),), ())


class Start:
    """What one start comes to."""

    def __init__(self, explained, convinces=False, alike=()):
        self.explained, self.convinces, self.alike = explained, convinces, alike
        self.unsure = False

    def doubted(self):
        self.unsure = True
        return self

    def agrees(self, other):
        return other.explained in self.alike


def started(tmp_path, *starts, footage=FILM):
    """Numbers of the starts that were made of `starts`, where None is refused, and the one that was taken."""
    made = []

    def begin(number, folder):
        assert folder.is_dir() and not list(folder.iterdir())
        made.append(number)
        if starts[number] is None:
            raise NotPossible("refused")
        return starts[number]

    return made, best_start(begin, footage, tmp_path / "work")


def test_the_start_that_explains_most_is_taken(tmp_path):
    starts = [Start(3.0), Start(9.0), Start(5.0)]
    assert started(tmp_path, *starts) == ([*range(STARTS)], starts[1])
    assert starts[1].unsure


def test_a_start_that_convinces_is_taken_and_no_further_one_is_made(tmp_path):
    sure, more = Start(3.0, convinces=True), Start(9.0)
    assert started(tmp_path / "a", sure, more) == ([0], sure)
    assert started(tmp_path / "b", more, sure) == ([0, 1], sure)
    assert not sure.unsure and not more.unsure


def test_no_further_start_is_made_where_two_agree(tmp_path):
    first, second = Start(3.0), Start(4.0, alike=[3.0])
    assert started(tmp_path, first, second, Start(9.0)) == ([0, 1], second)
    assert not second.unsure


def test_a_further_start_may_fail_and_a_first_one_is_refused(tmp_path):
    only = Start(3.0)
    assert started(tmp_path / "a", only, None, None) == ([0, 1, 2], only)
    with pytest.raises(NotPossible, match="refused"):
        started(tmp_path / "b", None, only)


@pytest.mark.parametrize(
    "other", [{"kind": "images"}, {"kind": "stereo"}, {"motion": "static"}, {"background": "scene"}]
)
def test_what_does_not_fly_is_mapped_once(tmp_path, other):
    first = Start(3.0)
    assert started(tmp_path, first, Start(9.0), footage=replace(FILM, **other)) == ([0], first)
    assert not first.unsure


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    given, _ = pieces(tmp_path_factory.mktemp("starts"), tumbling(40), which=range(16))
    return MappedFootage(given.found.models[0], given, Path(), [])


def test_a_model_explains_more_by_more_observations_and_by_nearer_ones(mapped):
    fewer = pycolmap.Reconstruction(mapped.model)
    take_out_images(fewer, set(fewer.reg_image_ids()[:4]))
    blurred, rng = pycolmap.Reconstruction(mapped.model), np.random.default_rng(0)
    for point in blurred.points3D.values():
        point.xyz = point.xyz + 0.01 * rng.standard_normal(3)
    assert 0 < replace(mapped, model=fewer).explained < mapped.explained
    assert 0 < replace(mapped, model=blurred).explained < mapped.explained
    assert replace(mapped, model=pycolmap.Reconstruction()).explained == 0


def test_a_model_convinces_that_places_all_by_a_motion_that_they_follow(mapped):
    assert mapped.convinces
    bent = pycolmap.Reconstruction(mapped.model)
    for image_id in sorted(bent.reg_image_ids())[::2]:
        frame = bent.frame(bent.image(image_id).frame_id)
        pose = frame.rig_from_world.matrix()
        frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:, :3]), pose[:, 3] + [0.0, 0.0, 5.0])
    assert not replace(mapped, model=bent).convinces
    part = pycolmap.Reconstruction(mapped.model)
    take_out_images(part, set(part.reg_image_ids()[:2]))
    assert not replace(mapped, model=part).convinces

    def moving(gain):
        options = mapped.given.options
        refine = replace(options.refine, following=Following(None, None, None, gain))
        return replace(mapped, given=replace(mapped.given, options=replace(options, refine=refine)))

    assert moving(1.5).convinces and not moving(3.0).convinces


def test_one_result_of_several_says_so(mapped):
    doubted = replace(mapped, warnings=["one"]).doubted()
    assert doubted.unsure and doubted.warnings[0] == "one" and "no two results agree" in doubted.warnings[1]


def test_two_models_agree_in_whatever_axes_and_not_where_images_are_turned(mapped):
    moved = pycolmap.Reconstruction(mapped.model)
    turn = pycolmap.Rotation3d(Rotation.from_rotvec([0.3, -0.5, 1.0]).as_matrix())
    moved.transform(pycolmap.Sim3d(2.0, turn, np.array([1.0, 2.0, 3.0])))
    assert mapped.agrees(replace(mapped, model=moved))
    bent = pycolmap.Reconstruction(moved)
    for image_id in sorted(bent.reg_image_ids())[-4:]:
        frame = bent.frame(bent.image(image_id).frame_id)
        pose = frame.rig_from_world.matrix()
        off = Rotation.from_rotvec([0.0, np.deg2rad(3.0), 0.0]).as_matrix()
        frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(off @ pose[:, :3]), pose[:, 3])
    assert not mapped.agrees(replace(mapped, model=bent))
    assert not mapped.agrees(replace(mapped, model=pycolmap.Reconstruction()))
