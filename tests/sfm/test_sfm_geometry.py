import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import scene

from massprops.errors import InputError
from massprops.sfm import pairs
from massprops.sfm.attitude import SECOND, quaternion, to_sequence
from massprops.sfm.points import SparsePoints, residuals
from massprops.sfm.precision import precision


def test_zlib_works_after_pycolmap():
    code = "import massprops, pycolmap, zlib; zlib.decompress(zlib.compress(b'ab' * 200000)); print('fine')"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
        try:
            out, _ = child.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            child.kill()  # a corrupted heap ignores SIGTERM
            raise
    assert child.returncode == 0
    assert out.strip() == "fine"


@pytest.mark.parametrize(
    ("model", "extra"),
    [
        ("SIMPLE_PINHOLE", []),
        ("PINHOLE", None),
        ("SIMPLE_RADIAL", [-0.12]),
        ("RADIAL", [-0.12, 0.05]),
        ("OPENCV", [-0.1, 0.04, 0.002, -0.003]),
    ],
)
def test_opencv_camera_projects_as_colmap(model, extra):
    from massprops.sfm.convert import opencv_camera
    from massprops.sfm.points import project_camera

    pycolmap = pytest.importorskip("pycolmap")
    focal = [800.0, 810.0] if model in ("PINHOLE", "OPENCV") else [800.0]
    camera = pycolmap.Camera(
        camera_id=1, model=model, width=640, height=480, params=[*focal, 322.0, 238.0, *(extra or [])]
    )
    rng = np.random.default_rng(0)
    c = rng.uniform([-0.4, -0.3, 1], [0.4, 0.3, 2], (40, 3))
    K, D = opencv_camera(camera)
    ours = project_camera(np.tile(K, (40, 1, 1)), np.tile(D, (40, 1)), c)
    theirs = np.array([camera.img_from_cam(x) for x in c]) - 0.5
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_camera_that_these_numbers_cannot_express():
    from massprops.sfm.convert import opencv_camera

    pycolmap = pytest.importorskip("pycolmap")
    camera = pycolmap.Camera.create_from_model_name(1, "THIN_PRISM_FISHEYE", 500.0, 640, 480)
    with pytest.raises(InputError, match="THIN_PRISM_FISHEYE"):
        opencv_camera(camera)


def test_points_survive_the_disk(tmp_path):
    _, points = scene.make(4, 20)
    points.save(tmp_path / "points.npz")
    again = SparsePoints.load(tmp_path / "points.npz")
    np.testing.assert_array_equal(again.obs_uv, points.obs_uv)
    np.testing.assert_array_equal(again.id, points.id)


def test_sequential_pairs_grow_linearly():
    few, many = pairs.sequential(60, 8), pairs.sequential(240, 8)
    assert len(many) < 4.6 * len(few)
    assert all(i < j for i, j in few)
    assert {(i, i + 1) for i in range(59)} <= set(few)


def test_exhaustive_pairs():
    assert len(pairs.exhaustive(10)) == len(set(pairs.exhaustive(10))) == 45


def test_loop_pairs_find_the_next_turn():
    angle = np.deg2rad(np.arange(80) * 9.0)  # a turn in 40 images
    d = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    found = pairs.spread_facing(d, 4, 9, 25)
    assert {(i, i + 40) for i in range(40)} <= set(found)
    assert len(found) <= 4 * 80
    assert all(j - i >= 9 and d[i] @ d[j] >= np.cos(np.deg2rad(25)) for i, j in found)


def test_signatures_bring_like_images_together():
    rng = np.random.default_rng(1)
    kinds = [rng.integers(0, 120, (80, 128)) for _ in range(4)]
    images = [np.clip(kinds[i % 4] + rng.integers(-6, 7, (80, 128)), 0, 255).astype(np.uint8) for i in range(12)]
    s = pairs.signatures(images, 0, words=16)
    assert all((j - i) % 4 == 0 for i, j in pairs.similar(s, 2, 1))
    np.testing.assert_array_equal(s, pairs.signatures(images, 0, words=16))


def test_signatures_of_empty_images():
    assert pairs.signatures([np.zeros((0, 128), np.uint8)] * 3, 0).shape[0] == 3


def test_precision_matches_independent_noise():
    views, points = scene.make(14, 250, noise=0.3)
    p = precision(views, points, True, 0)
    # without an adjustment the residuals are the noise, and both covariances agree
    assert p.rms_px == pytest.approx(0.3, rel=0.1)
    assert p.focal_relative == pytest.approx(p.focal_relative_model, rel=0.3)
    assert 1e-5 < np.median(p.attitude) < 1e-2
    assert precision(views, points, False, 0).focal_relative == 0


def test_precision_sees_errors_that_tracks_share():
    views, points = scene.make(14, 250)
    rng = np.random.default_rng(2)
    drift = rng.normal(size=(250, 2))[points.obs_point] * (points.obs_view[:, None] - 6.5) / 4 * 0.3
    wrong = SparsePoints(**{**points.__dict__, "obs_uv": points.obs_uv + drift})
    p = precision(views, wrong, True, 0)
    assert p.focal_relative > 1.5 * p.focal_relative_model


def test_precision_sees_errors_alike_on_one_side_of_the_camera():
    views, points = scene.make(14, 250, noise=0.1)
    away = points.xyz - np.median(points.xyz, axis=0)
    before = np.einsum("kij,kj->ki", views.R[points.obs_view], away[points.obs_point])
    # as blocks of a codec, or a limb: outwards on one half of the images, always
    error = 0.5 * np.where(before[:, :1] > 0, [[1.0, 0.0]], [[0.0, 0.0]])
    shared, mixed = (
        precision(views, SparsePoints(**{**points.__dict__, "obs_uv": points.obs_uv + e}), True, 0).focal_relative
        for e in (error, np.random.default_rng(3).permutation(error))
    )
    assert shared > 1.5 * mixed


def test_precision_scales_with_noise():
    a = precision(*scene.make(10, 100, noise=0.1), True, 1)
    b = precision(*scene.make(10, 100, noise=0.4), True, 1)
    assert b.focal_relative == pytest.approx(4 * a.focal_relative, rel=0.1)


def test_attitude_is_the_rotation_of_the_view():
    views, points = scene.make(10, 30, noise=0.2)
    s = to_sequence(views, points, np.arange(10), None)
    from scipy.spatial.transform import Rotation

    again = Rotation.from_quat(s.attitude.q[:, [1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(again, views.R, atol=1e-12)
    assert np.all(np.sum(s.attitude.q[1:] * s.attitude.q[:-1], axis=1) > 0)
    assert s.cameras[0].sigma_px == pytest.approx(0.2, rel=0.15)
    assert len(s.tracks.uv) == 300
    np.testing.assert_allclose(s.cameras[0].intrinsics, [900, 900, 319.5, 239.5])
    assert s.cameras[0].rate_hz == pytest.approx(1.0)


def test_a_fisheye_gives_the_tracks_of_a_pinhole_camera():
    from massprops.sfm.fisheye import rational
    from massprops.sfm.points import project

    views, points = scene.make(6, 40)
    v, k = points.obs_view, rational(np.array([-0.02, 0.0, 0.0, 0.0]), 0.5)
    bent = replace(views, distortion=np.tile(k, (6, 1)))
    uv = project(bent.K[v], bent.distortion[v], bent.R[v], bent.t[v], points.xyz[points.obs_point])
    assert np.abs(uv - points.obs_uv).max() > 1
    s = to_sequence(bent, replace(points, obs_uv=uv), np.arange(6), None)
    straight = to_sequence(views, points, np.arange(6), None)
    np.testing.assert_allclose(s.tracks.uv, straight.tracks.uv, atol=1e-3)
    assert not s.cameras[0].distortion.any() and len(s.cameras[0].distortion) == 4


def test_static_footage_has_no_attitude_and_its_clock_is_of_no_interest():
    views, points = scene.make(5, 20)
    still = views.__class__(**{**views.__dict__, "timestamp_ns": np.full(5, -1)})
    s = to_sequence(still, points, np.array([0, 2, 4, 6, 8]), "the object is still")
    assert s.attitude is None
    np.testing.assert_array_equal(np.unique(s.tracks.timestamp_ns), np.arange(0, 9, 2) * SECOND)
    assert s.warnings == ("the object is still: no attitude history is written",)
    moving = to_sequence(still, points, np.array([0, 2, 4, 6, 8]), None)
    assert any("no clock" in w for w in moving.warnings)


def test_one_observation_of_a_feature_per_image(tmp_path):
    from massprops.sequence.read import read_sequence
    from massprops.sequence.write import write_sequence

    views, points = scene.make(4, 10)
    twice = SparsePoints(
        **{
            **points.__dict__,
            "obs_view": np.r_[points.obs_view, 0],
            "obs_point": np.r_[points.obs_point, 3],
            "obs_uv": np.r_[points.obs_uv, points.obs_uv[3:4] + 5],
        }
    )
    s = to_sequence(views, twice, np.arange(4), None)
    assert len(s.tracks.uv) == 40
    assert np.abs(residuals(views, points)).max() < 1e-9
    back = read_sequence(write_sequence(tmp_path / "s", s))
    np.testing.assert_allclose(back.attitude.q, s.attitude.q, atol=1e-9)
    np.testing.assert_allclose(back.tracks.uv, s.tracks.uv, atol=1e-5)
    assert not back.warnings


def test_a_sequence_takes_its_tracks_from_one_camera():
    views, points = scene.make(10, 50, step_deg=5.0)
    K = views.K.copy()
    K[7:, 0, 0] *= 1.5
    s = to_sequence(replace(views, K=K), points, np.arange(10), None)
    assert s.cameras[0].intrinsics[0] == K[0, 0, 0]
    assert set(s.tracks.timestamp_ns.tolist()) == set(views.timestamp_ns[:7].tolist())
    assert len(s.attitude.q) == 10 and any("3 images have no tracks" in w for w in s.warnings)


def test_quaternions_keep_their_sign():
    from scipy.spatial.transform import Rotation

    R = Rotation.from_euler("z", np.arange(0, 720, 30)[:, None], degrees=True).as_matrix()
    q = quaternion(R)
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0)
