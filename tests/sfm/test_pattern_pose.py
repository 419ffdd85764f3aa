"""Photographs of a cloth whose pattern repeats, placed by the few features that are unique."""

from dataclasses import replace

import numpy as np
import pytest
import test_mapping
from scipy.spatial.transform import Rotation
from test_repeated import noisy, words

from massprops.sfm.distinct import unit
from massprops.sfm.mapping import MappingOptions, verify
from massprops.sfm.pattern_pose import Known, Photograph, find_pose
from massprops.sfm.points import SparsePoints, project
from massprops.views import Views

CELL, FOCAL = 0.12, 700.0


def cloth():
    """(m, 3) points of a plane, five in each cell of a pattern, and what each looks like (m,)."""
    cells = np.stack(np.meshgrid(np.arange(-12, 12), np.arange(-12, 12)), -1).reshape(-1, 2)
    within = np.random.default_rng(5).uniform(0, 1, (5, 2))
    xy = CELL * (cells[:, None] + within[None]).reshape(-1, 2)
    return np.column_stack([xy, np.zeros(len(xy))]), np.tile(np.arange(5), len(cells))


def camera(azimuth, height):
    """R, t of a camera that looks at the middle of the cloth."""
    R = Rotation.from_euler("zx", [azimuth, -90 - height], degrees=True).as_matrix()
    return R, np.array([0.0, 0.0, 3.0])


@pytest.fixture(scope="module")
def seen():
    """Three placed views, and a fourth some 25 degrees higher: its features, and each feature's point."""
    rng = np.random.default_rng(0)
    xyz, kind = cloth()
    look = words(5, rng)[kind]
    poses = [camera(a, 35) for a in (-12, 0, 12)]
    K = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1.0]])
    views = Views(
        tuple("abc"),
        np.arange(3),
        np.tile([640, 480], (3, 1)),
        np.tile(K, (3, 1, 1)),
        np.zeros((3, 4)),
        np.array([R for R, _ in poses]),
        np.array([t for _, t in poses]),
    )
    inside, places = [], []
    for R, t in (*poses, camera(5, 58)):
        n = len(xyz)
        uv = project(np.tile(K, (n, 1, 1)), np.zeros((n, 4)), np.tile(R, (n, 1, 1)), np.tile(t, (n, 1)), xyz)
        inside.append(np.flatnonzero((uv >= 0).all(1) & (uv < [640, 480]).all(1)))
        places.append(uv[inside[-1]] + rng.normal(0, 0.3, (len(inside[-1]), 2)))
    view = np.repeat(np.arange(3), [len(i) for i in inside[:3]])
    point = np.concatenate(inside[:3])
    nothing = np.zeros(len(xyz))
    points = SparsePoints(
        np.arange(len(xyz)), xyz, np.zeros((len(xyz), 3), np.uint8), nothing, view, point, np.concatenate(places[:3])
    )
    known = Known(views, points, noisy(look[point], rng))
    uv = places[3]
    ray = (uv - K[:2, 2]) / FOCAL
    none = np.zeros(0, int)
    size = np.array([640, 480])
    image = Photograph(K, np.zeros(4), size, uv, ray, unit(noisy(look[inside[3]], rng)), none, np.zeros((0, 3)))
    return known, image, xyz[inside[3]]


def clues(image, feature, xyz):
    return replace(image, feature=feature, xyz=xyz)


def test_a_third_of_the_clues_is_enough(seen):
    known, image, xyz = seen
    rng = np.random.default_rng(1)
    feature = rng.permutation(len(xyz))[:24]
    at = xyz[feature].copy()
    at[8:] = xyz[rng.permutation(len(xyz))[:16]]  # two thirds of them wrong
    pose = find_pose(known, clues(image, feature, at), rng)
    R, t = camera(5, 58)
    assert pose is not None and pose.clues >= 8 and pose.found > 100
    assert np.rad2deg(Rotation.from_matrix(pose.R @ R.T).magnitude()) < 0.1
    assert np.linalg.norm(pose.R.T @ pose.t - R.T @ t) < 0.01  # the next cell is 0.12 away


def test_clues_that_agree_on_nothing_place_nothing(seen):
    known, image, xyz = seen
    rng = np.random.default_rng(2)
    feature = rng.permutation(len(xyz))[:24]
    assert find_pose(known, clues(image, feature, xyz[rng.permutation(len(xyz))[:24]]), rng) is None
    assert find_pose(known, clues(image, feature[:3], xyz[feature[:3]]), rng) is None
    assert find_pose(known, image, rng) is None


def test_the_pattern_alone_does_not_choose_its_cell(seen):
    """Six clues for one cell and six for the next: both poses show the pattern equally well."""
    known, image, xyz = seen
    rng = np.random.default_rng(3)
    middle = np.flatnonzero(np.linalg.norm(xyz[:, :2], axis=1) < 0.5)
    feature = rng.permutation(middle)[:12]
    at = xyz[feature].copy()
    at[6:, 0] += CELL
    assert find_pose(known, clues(image, feature, at), rng) is None
    pose = find_pose(known, clues(image, feature[:8], at[:8]), rng)
    assert pose is not None and pose.clues == 6


def test_matches_too_few_for_a_geometry_are_kept(tmp_path):
    """They are what a left-out image has to be placed by."""
    import pycolmap
    import scene

    from massprops.sfm.database import write_database

    views, points = scene.make(2, 40)
    database = tmp_path / "database.db"
    ids = write_database(database, test_mapping.footage(views), test_mapping.features(views, points))
    a, b = views.names
    verify(database, ids, {(a, b): np.array([[0, 0], [1, 1]], np.uint32)}, MappingOptions())
    with pycolmap.Database.open(database) as db:
        assert len(db.read_matches(ids[a], ids[b])) == 2
        assert not db.exists_two_view_geometry(ids[a], ids[b])
