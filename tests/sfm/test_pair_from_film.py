"""A pair of cameras before a tumbling body, placed by the film of its first one where the pair leaves images out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import test_mapping
from scipy.spatial.transform import Rotation
from test_free_motion import tumbling
from test_joined_pieces import filmed

from massprops.errors import NotPossible
from massprops.sfm import reconstruct
from massprops.sfm.attempt import Attempt, ModelInputs, SfmOptions
from massprops.sfm.convert import take_out_images, to_views
from massprops.sfm.database import write_database
from massprops.sfm.film_starts import MappedFootage
from massprops.sfm.footage import CameraRecord, FrameRecord
from massprops.sfm.mapping import MappingOptions, map_images, match, quiet
from massprops.sfm.pair_from_film import asks_for_film, by_film, film_of_first
from massprops.sfm.points import project
from massprops.views import Views

MOMENTS, FOCAL = 12, 900.0
TO_SECOND = np.eye(4)
TO_SECOND[:3, :3] = Rotation.from_euler("y", 3, degrees=True).as_matrix()
TO_SECOND[:3, 3] = [-0.7, 0.02, 0.01]


def seen_by_both():
    """Views of cam0 and cam1, what they show, and the pair's footage."""
    first, points = filmed(range(MOMENTS), tumbling(MOMENTS))
    second = replace(
        first,
        names=tuple(n.replace("cam0", "cam1") for n in first.names),
        R=TO_SECOND[:3, :3] @ first.R,
        t=first.t @ TO_SECOND[:3, :3].T + TO_SECOND[:3, 3],
    )
    views = Views.joined([first, second])
    v, p = (np.concatenate([a, a + more]) for a, more in ((points.obs_view, MOMENTS), (points.obs_point, 0)))
    uv = project(views.K[v], views.distortion[v], views.R[v], views.t[v], points.xyz[p])
    points = replace(points, obs_view=v, obs_point=p, obs_uv=uv)
    known = {"focal_px": FOCAL, "principal_point": (319.5, 239.5), "focal_source": "given"}
    film = test_mapping.footage(first, **known)
    cameras = tuple(
        CameraRecord(i, (640, 480), **known, T_BS=T) for i, T in enumerate((np.eye(4), np.linalg.inv(TO_SECOND)))
    )
    frames = tuple(
        FrameRecord(n, int(n[3]), int(t), i)
        for i, (n, t) in enumerate(zip(views.names, views.timestamp_ns, strict=True))
    )
    return views, points, replace(film, kind="stereo", cameras=cameras, frames=frames)


def mapped(folder, footage, features):
    """What matching all images of a footage comes to."""
    quiet()
    names, database = [f.name for f in footage.frames], folder / "database.db"
    (folder / "frames").mkdir(parents=True)
    write_database(database, footage, {n: features[n] for n in names})
    mapping = MappingOptions(masked=True, fixed_intrinsics=True, threads=1)
    match(database, [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]], mapping)
    footage = replace(footage, folder=folder)
    models = map_images(database, folder / "frames", folder / "models", mapping, len(names))
    found = Attempt(database, mapping, models, features, lambda pairs: None, False, False, [])
    return MappedFootage(models[0], ModelInputs(found, footage, SfmOptions(threads=1), folder / "work"), Path(), [])


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The truth, the pair whole, and its first camera's film."""
    views, points, footage = seen_by_both()
    features, folder = test_mapping.features(views, points), tmp_path_factory.mktemp("pair")
    pair = mapped(folder / "pair", footage, features)
    film = mapped(folder / "film", film_of_first(footage), features)
    return views, pair, film


def without(mapped_pair, moments):
    """A pair of which some moments are left out."""
    import pycolmap

    part = pycolmap.Reconstruction(mapped_pair.model)
    names = {f"cam0/{k:06d}.png" for k in moments}
    take_out_images(part, [i for i in part.reg_image_ids() if part.image(i).name in names])
    return replace(mapped_pair, model=part)


def test_the_film_of_a_pair_is_one_of_its_first_camera(both):
    _, pair, film = both
    footage = film.given.footage
    assert not footage.rig and footage.moving_pictures and len(footage.cameras) == 1
    assert [f.name for f in footage.frames] == [f"cam0/{k:06d}.png" for k in range(MOMENTS)]
    assert pair.given.footage.rig and pair.model.num_reg_images() == 2 * MOMENTS


def test_a_pair_that_leaves_images_out_is_placed_by_its_film_in_metres(both):
    truth, pair, film = both
    part = without(pair, range(8, MOMENTS))
    assert part.model.num_reg_images() == 16
    found = by_film(part, replace(film, warnings=["of the film"], unsure=True))
    views = to_views(found.model)[0]
    assert views.names == truth.names
    assert test_mapping.attitude_error(views, truth) < 1e-3
    lengths = [np.linalg.norm(v.centres[0] - v.centres[1:], axis=1) for v in (views, truth)]
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=2e-3, atol=2e-3)
    assert found.model.num_points3D() > 100
    assert found.unsure and found.warnings == ["of the film"] and found.given.footage.rig


def test_a_film_is_asked_where_images_are_left_out_or_stray(both):
    import pycolmap

    _, pair, film = both
    assert not asks_for_film(pair) and not asks_for_film(film)
    part = without(pair, range(8, MOMENTS))
    assert asks_for_film(part)
    # on a table a motion leads nowhere
    still = replace(pair.given.footage, background="still")
    assert not asks_for_film(replace(part, given=replace(part.given, footage=still)))
    bent = pycolmap.Reconstruction(pair.model)
    for frame_id in sorted(bent.reg_frame_ids())[::2]:
        pose = bent.frame(frame_id).rig_from_world.matrix()
        off = Rotation.from_rotvec([0.0, np.deg2rad(2.0), 0.0]).as_matrix()
        bent.frame(frame_id).rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(off @ pose[:, :3]), pose[:, 3])
    assert asks_for_film(replace(pair, model=bent))


def test_a_second_camera_that_shows_nothing_of_the_film_is_not_placed(both, tmp_path):
    truth, pair, film = both
    _, points, footage = seen_by_both()
    own, others = (test_mapping.features(truth, points, seed) for seed in (0, 1))
    features = {n: (own if n.startswith("cam0") else others)[n] for n in truth.names}
    apart = mapped(tmp_path / "apart", footage, features)
    with pytest.raises(NotPossible, match="second camera shows too few"):
        by_film(replace(apart, model=pair.model), film)


def test_a_film_that_does_not_convince_must_place_more(both):
    _, pair, film = both
    part = without(pair, range(8, MOMENTS))
    few = without(film, range(6, MOMENTS))
    assert not few.convinces and by_film(part, few) is part
    doubted = by_film(part, few.doubted())
    assert doubted.unsure and doubted.model is part.model
    assert by_film(pair, few.doubted()) is pair  # what convinces is not in doubt
    more = by_film(without(pair, range(4, MOMENTS)), few.doubted())
    assert more.model.num_reg_frames() == 6 and more.unsure


@pytest.mark.parametrize("refused", [False, True])
def test_a_pair_keeps_its_own_model_where_its_film_is_refused(both, tmp_path, monkeypatch, refused):
    _, pair, film = both
    part = without(pair, range(8, MOMENTS))

    def start(footage, *_):
        if not footage.rig and refused:
            raise NotPossible("fewer than three images")
        return part if footage.rig else film

    monkeypatch.setattr(reconstruct, "_mapped", start)
    monkeypatch.setattr(reconstruct, "_finished", lambda found, progress: found)
    footage = pair.given.footage
    found = reconstruct.reconstruct(footage, tmp_path / "work", SfmOptions(threads=1))
    assert found.model.num_reg_images() == (16 if refused else 2 * MOMENTS)
