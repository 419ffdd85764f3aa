"""The lens model is the one that predicts observations it was not fitted to."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from massprops.sfm.points import project

SIZE, FOCAL = (640, 480), 500.0
NONE, ONE, TWO, ALL = "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"


def pictured(lenses, reach=3.0, noise=0.3, n=8, m=300, seed=0, start=ONE):
    """A model of points in a box of half side `reach`, 8 away, seen by n images of as many cameras as `lenses`.

    Args:
        lenses: k1, k2, p1, p2 and fy / fx of every camera; the images take turns.
        start: lens model at the beginning, without distortion.
    """
    import pycolmap

    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-reach, reach, (m, 3))
    R = Rotation.from_euler("yx", np.column_stack([np.arange(n) * 7.0, 15 * np.sin(np.arange(n))]), degrees=True)
    model = pycolmap.Reconstruction()
    for c in range(len(lenses)):
        params = [FOCAL, 320, 240] + [0.0] * (start == ONE)
        model.add_camera_with_trivial_rig(
            pycolmap.Camera(camera_id=c + 1, model=start, width=SIZE[0], height=SIZE[1], params=params)
        )
    tracks = [pycolmap.Track() for _ in xyz]
    for i, turn in enumerate(R.as_matrix()):
        *d, ratio = lenses[i % len(lenses)]
        K = np.array([[FOCAL, 0, 319.5], [0, FOCAL * ratio, 239.5], [0, 0, 1]])
        t = np.array([0.0, 0.0, 8.0])
        uv = project(*(np.tile(a, (m,) + (1,) * np.ndim(a)) for a in (K, np.array(d), turn, t)), xyz)
        seen = np.flatnonzero(np.all((uv > 0) & (uv < np.array(SIZE) - 1), axis=1))
        uv = uv[seen] + noise * rng.standard_normal((len(seen), 2)) + 0.5
        for k, p in enumerate(seen):
            tracks[p].add_element(i + 1, k)
        image = pycolmap.Image(name=f"cam0/{i}.png", camera_id=i % len(lenses) + 1, image_id=i + 1, keypoints=uv)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(turn), t))
    for x, track in zip(xyz, tracks, strict=True):
        if track.length() >= 3:
            model.add_point3D(x + 0.01 * rng.standard_normal(3), track)
    return model


def chosen(model, small=False, seed=0):
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import Effort, RefineOptions, adjust, refine

    quiet()
    if not small:
        # as mapping leaves it
        adjust(model, True, True, 1.0, 1, Effort(20))
    return refine(model, RefineOptions(), True, True, 1, small, seed)


@pytest.mark.parametrize(
    ("lens", "expected"),
    [
        ((0.0, 0.0, 0.0, 0.0, 1.0), NONE),
        ((-0.08, 0.0, 0.0, 0.0, 1.0), ONE),
        ((-0.25, 0.2, 0.0, 0.0, 1.0), TWO),
        ((-0.08, 0.0, 5e-3, -5e-3, 1.0), ALL),
        ((0.0, 0.0, 0.0, 0.0, 1.03), ALL),
    ],
)
def test_the_lens_that_took_the_images_is_chosen(lens, expected):
    from massprops.sfm.convert import opencv_camera

    model = pictured([lens])
    refined = chosen(model)
    choice = refined.lenses[1]
    assert choice.model == expected and refined.bent == (expected != NONE)
    K, d = opencv_camera(model.cameras[1])
    assert K[0, 0] == pytest.approx(FOCAL, rel=0.01) and K[1, 1] == pytest.approx(lens[4] * K[0, 0], rel=4e-3)
    assert d[0] == pytest.approx(lens[0], abs=0.015) and d[2:] == pytest.approx(lens[2:4], abs=1e-3)
    best = min(choice.held_out_px.values())
    assert choice.observations > 150 and choice.held_out_px[expected] < 1.03 * best


@pytest.mark.parametrize("seed", range(3))
def test_noise_asks_for_no_lens(seed):
    model = pictured([(0.0, 0.0, 0.0, 0.0, 1.0)], noise=0.6, seed=seed, m=200)
    refined = chosen(model, seed=seed)
    assert refined.lenses[1].model == NONE
    np.testing.assert_array_equal(model.cameras[1].params[1:], [320, 240, 0])


def test_every_camera_has_the_lens_of_its_own():
    model = pictured([(-0.12, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0, 1.0)], n=10)
    refined = chosen(model)
    assert [refined.lenses[c].model for c in (1, 2)] == [ONE, NONE]
    assert set(refined.precision.focal_by_camera) == {1, 2}


def test_a_small_body_in_the_middle_carries_no_distortion():
    """A body over a quarter of the image: a true k1 moves its outermost features by less than a noise of 0.3 px."""
    model = pictured([(-0.02, 0.0, 0.0, 0.0, 1.0)], reach=0.7)
    refined = chosen(model, small=True)
    assert not refined.bent and not refined.lenses
    assert model.cameras[1].params[3] == 0


def test_a_strong_lens_shows_on_one_object_too():
    model = pictured([(-0.3, 0.0, 0.0, 0.0, 1.0)], reach=2.0)
    refined = chosen(model, small=True)
    assert refined.lenses[1].model == ONE
    assert model.cameras[1].params[3] == pytest.approx(-0.3, abs=0.05)


def fisheye_pictures(k, angle_deg, start=ONE):
    """As `pictured`, by a fisheye of 300 px whose edge looks `angle_deg` off its axis."""
    import pycolmap

    model = pictured([(0.0, 0.0, 0.0, 0.0, 1.0)], reach=8.0 * np.tan(np.deg2rad(angle_deg)) * 0.7, n=10, m=600)
    out = pycolmap.Reconstruction()
    out.add_camera_with_trivial_rig(
        pycolmap.Camera(camera_id=1, model=start, width=SIZE[0], height=SIZE[1], params=[300.0, 320, 240, -0.2])
    )
    rng = np.random.default_rng(1)
    tracks = {p: pycolmap.Track() for p in model.point3D_ids()}
    for i in sorted(model.reg_image_ids()):
        M = np.asarray(model.image(i).cam_from_world().matrix())
        uv = []
        for p in tracks:
            c = M[:, :3] @ model.point3D(p).xyz + M[:, 3]
            t = np.arctan2(np.hypot(c[0], c[1]), c[2])
            place = 300.0 * t * (1 + k * t * t) * c[:2] / np.hypot(c[0], c[1]) + [319.5, 239.5]
            if t < np.deg2rad(angle_deg) and (place > 0).all() and (place < np.array(SIZE) - 1).all():
                tracks[p].add_element(i, len(uv))
                uv.append(place + 0.3 * rng.standard_normal(2) + 0.5)
        image = pycolmap.Image(name=f"cam0/{i}.png", camera_id=1, image_id=i, keypoints=np.array(uv))
        out.add_image_with_trivial_frame(image, model.image(i).cam_from_world())
    for p, track in tracks.items():
        if track.length() >= 3:
            out.add_point3D(model.point3D(p).xyz, track)
    return out


@pytest.mark.parametrize("k", [0.0, -0.05])
def test_a_fisheye_is_seen_where_no_polynomial_fits(k):
    from massprops.sfm.convert import to_points, to_views
    from massprops.sfm.points import residuals

    model = fisheye_pictures(k, 60)
    refined = chosen(model)
    assert refined.lenses[1].model == "OPENCV_FISHEYE"
    errors = refined.lenses[1].held_out_px
    assert errors["OPENCV_FISHEYE"] < errors["OPENCV"]
    # what reads it as a pinhole camera's distortion agrees with COLMAP's own projection
    views, ids = to_views(model)
    assert views.distortion.shape[1] == 8
    model.update_point_3d_errors()
    points = to_points(model, ids)
    away = np.linalg.norm(residuals(views, points), axis=1)
    mean = np.bincount(points.obs_point, away) / np.bincount(points.obs_point)
    np.testing.assert_allclose(mean, points.error, atol=2e-2)
    assert model.cameras[1].params[0] == pytest.approx(300, rel=0.01)


@pytest.mark.parametrize("k", [(0.0, 0.0, 0.0, 0.0), (-0.04, 0.005, 0.0, 0.0), (0.05, -0.02, 0.01, -0.002)])
def test_a_fisheye_and_its_rational_model_agree(k):
    """Over the whole image, by the library that undistorts it."""
    import cv2

    from massprops.sfm.fisheye import rational, widest_angle

    K = np.array([[300.0, 0, 320], [0, 300, 240], [0, 0, 1]])
    angle = np.linspace(0.01, widest_angle(np.array(k), 400 / 300), 100)
    turn = np.linspace(0, 20, 100)
    ray = np.column_stack([np.tan(angle) * np.cos(turn), np.tan(angle) * np.sin(turn), np.ones(100)])[:, None]
    zero = np.zeros(3)
    true = cv2.fisheye.projectPoints(ray, zero, zero, K, np.array(k))[0]
    ours = cv2.projectPoints(ray, zero, zero, K, rational(np.array(k), 400 / 300))[0]
    assert np.abs(true - ours).max() < 0.03


def test_slopes_of_the_lens_are_those_of_its_factor():
    from massprops.sfm.fisheye import rational
    from massprops.sfm.points import radial_factor

    u = np.linspace(0.0, 2.0, 50)
    for d in (np.array([-0.2, 0.05, 1e-3, 2e-3]), rational(np.array([-0.03, 0.01, 0.0, 0.0]), 1.2)):
        rows = np.tile(d, (50, 1))
        step = (radial_factor(rows, u + 1e-6)[0] - radial_factor(rows, u - 1e-6)[0]) / 2e-6
        np.testing.assert_allclose(radial_factor(rows, u)[1], step, atol=1e-8)


def test_what_is_held_out_leaves_tracks_whole(monkeypatch):
    from massprops.sfm.lens import hold_out

    model = pictured([(0.0, 0.0, 0.0, 0.0, 1.0)])
    kept, held = hold_out(model, 5)
    total = sum(model.point3D(p).track.length() for p in model.point3D_ids())
    left = [kept.point3D(p).track.length() for p in kept.point3D_ids()]
    assert len(left) == len(model.point3D_ids()) and min(left) >= 3
    assert sum(left) + len(held.point) == total and 0.1 < len(held.point) / total < 0.21
    monkeypatch.setattr("massprops.sfm.lens.MOST_TRACKS", 50)
    few, some = hold_out(model, 5)
    assert len(few.point3D_ids()) == 50 and set(some.point) <= set(few.point3D_ids())
    monkeypatch.undo()
    again = hold_out(model, 5)[1]
    np.testing.assert_array_equal(held.point, again.point)
    np.testing.assert_array_equal(held.image, again.image)


def test_a_fall_within_its_scatter_is_none():
    from massprops.sfm.lens import HeldOut, falls

    rng = np.random.default_rng(0)
    held = HeldOut(np.repeat(np.arange(20), 50), np.tile(np.arange(50), 20), np.zeros((1000, 2)))
    before = rng.chisquare(2, 1000)
    assert not falls(before, before + 0.05 * rng.standard_normal(1000), held)
    assert falls(before, before - 0.05, held)
    # half of the images gain and half lose: no evidence, however many observations there are
    assert not falls(before, before + np.where(held.image % 2, 0.2, -0.21), held)


def test_k1_is_asked_of_its_own_likelihood():
    from massprops.sfm.lens import k1_evidence

    assert k1_evidence(0.03, 0.005) > 5
    assert k1_evidence(0.0, 0.002) < -2
    assert abs(k1_evidence(0.3, 1.0)) < 0.1


@pytest.mark.parametrize("k1", [-0.05, 0.05])
def test_a_weak_lens_does_not_pass_for_another_focal_length(k1):
    """Features about the middle alone: errors held out say nothing of k1, which the focal length stands in for."""
    model = pictured([(k1, 0, 0, 0, 1.0)], reach=1.3, noise=0.1, n=24, m=400)
    found = chosen(model)
    camera = model.cameras[1]
    assert found.lenses[1].model == ONE
    assert camera.params[3] == pytest.approx(k1, abs=4 * found.precision.distortion)
    assert abs(camera.params[0] / FOCAL - 1) < 4 * found.precision.focal_relative


def test_a_lens_of_a_thing_on_a_table_is_taken_where_it_shows_in_a_part_of_the_image_alone():
    """Features on one object, whose lens is too weak to be looked for otherwise."""
    from dataclasses import replace

    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import RefineOptions, refine

    quiet()
    models = [pictured([(-0.05, 0.0, 0.0, 0.0, 1.0)], reach=1.1, noise=0.05, n=24, m=400) for _ in range(2)]
    usual = RefineOptions()
    apart, on_table = (
        refine(m, o, True, True, 1, True) for m, o in zip(models, (usual, replace(usual, on_table=True)), strict=True)
    )
    assert not apart.lenses
    assert on_table.lenses[1].model == ONE
    assert models[1].cameras[1].params[3] == pytest.approx(-0.05, abs=0.02)


@pytest.mark.parametrize(("k1", "worth_it"), [(0.0, False), (-0.02, True), (-0.08, True)])
def test_an_adjustment_of_k1_is_foreseen(k1, worth_it):
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import PROMISING, Effort, RefineOptions, _k1, _k1_expected, adjust

    quiet()
    options, model = RefineOptions(), pictured([(k1, 0.0, 0.0, 0.0, 1.0)], n=16, reach=1.5)
    adjust(model, True, False, 0.5, 1, Effort())
    expected, found = _k1_expected(model, options, True, 0.5), _k1(model, options, True, 0.5, 1)
    assert expected.shown(PROMISING * options.significance, PROMISING * options.visible_px) == worth_it
    assert not found.shown(options.significance, options.visible_px) or worth_it
    assert expected.k1 == pytest.approx(found.k1, abs=3 * found.sigma + 0.2 * abs(k1))


def test_k1_of_next_to_no_observations_is_not_foreseen():
    from massprops.sfm.refine import RefineOptions, _k1_expected

    model = pictured([(-0.08, 0.0, 0.0, 0.0, 1.0)], n=3, m=5, reach=1.0)
    assert not _k1_expected(model, RefineOptions(), True, 0.5).shown(0.0, 0.0)
