"""A tiny mapping without images: every point has a descriptor of its own, so matching is real and exact."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scene
from scipy.spatial.transform import Rotation

from massprops.errors import InputError, NotPossible
from massprops.sfm import attempt, reconstruct
from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord, read_footage
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.steady import largest_jump, steady_stretch, stretches


def footage(views, folder=Path(), **camera):
    frames = tuple(
        FrameRecord(n, 0, int(t), i) for i, (n, t) in enumerate(zip(views.names, views.timestamp_ns, strict=True))
    )
    return FootageRecord(
        folder, "", "video", "tumbling", "black", True, (CameraRecord(0, (640, 480), **camera),), frames
    )


def features(views, points, seed=0):
    rng = np.random.default_rng(seed)
    words = np.zeros((len(points.xyz), 128))
    for row in words:
        row[rng.permutation(128)[:12]] = 148.0  # norm 512, nearly orthogonal to each other
    out = {}
    for i, name in enumerate(views.names):
        own = points.obs_view == i
        xy = points.obs_uv[own] + 0.5
        keypoints = np.column_stack([xy, np.ones(len(xy)), np.zeros(len(xy))]).astype(np.float32)
        out[name] = (keypoints, words[points.obs_point[own]].astype(np.uint8))
    return out


def solve(folder, seed=0, mapper="incremental", **camera):
    from massprops.sfm.database import write_database
    from massprops.sfm.mapping import MappingOptions, map_images, match, quiet
    from massprops.sfm.refine import RefineOptions, refine

    quiet()
    folder.mkdir()
    views, points = scene.make(8, 120, focal=820.0, noise=0.05, step_deg=10)
    database = folder / "database.db"
    write_database(database, footage(views, **camera), features(views, points))
    fixed = camera.get("focal_source") == "given"
    options = MappingOptions(mapper=mapper, fixed_intrinsics=fixed, masked=True, seed=seed, threads=1)
    names = views.names
    match(database, [(names[i], names[j]) for i in range(8) for j in range(i + 1, 8)], options)
    model = map_images(database, folder, folder / "models", options, 8)[0]
    refined = refine(model, RefineOptions(), not fixed, not fixed, 1)
    accuracy, bent = refined.precision, refined.bent
    return model, accuracy, bent, views


def attitude_error(found, views):
    """Largest angle [rad] after the best common rotation of the world."""
    U, _, Vt = np.linalg.svd(np.einsum("nji,njk->ik", views.R, found.R))
    A = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    D = np.einsum("nij,nkj->nik", views.R @ A, found.R)
    return np.arccos(np.clip((np.trace(D, axis1=1, axis2=2) - 1) / 2, -1, 1)).max()


def test_mapping_finds_the_truth_and_repeats_itself(tmp_path):
    from massprops.sfm.convert import to_views

    model, accuracy, bent, truth = solve(tmp_path / "a", 3)
    views, _ = to_views(model)
    assert views.names == truth.names
    assert abs(views.K[0, 0, 0] / 820 - 1) < max(0.005, 3 * accuracy.focal_relative)
    assert attitude_error(views, truth) < 5e-3
    assert not bent
    again, _ = to_views(solve(tmp_path / "b", 3)[0])
    np.testing.assert_array_equal(views.R, again.R)
    np.testing.assert_array_equal(views.K, again.K)


def test_a_given_camera_stays_as_it_is(tmp_path):
    from massprops.sfm.convert import to_views

    model, accuracy, _, _ = solve(tmp_path / "a", focal_px=820.0, principal_point=(319.5, 239.5), focal_source="given")
    views, _ = to_views(model)
    np.testing.assert_allclose(views.K[0], [[820, 0, 319.5], [0, 820, 239.5], [0, 0, 1]])
    assert accuracy.focal_relative == 0


def test_an_imported_model_keeps_its_cameras(tmp_path):
    from massprops.sfm.convert import to_points, to_views
    from massprops.sfm.points import residuals
    from massprops.sfm.sparse_import import import_sparse

    model, _, _, truth = solve(tmp_path / "a")
    (tmp_path / "m" / "sparse" / "0").mkdir(parents=True)
    model.write(tmp_path / "m" / "sparse" / "0")
    _, views, points, warnings = import_sparse(tmp_path / "m", footage(truth))
    first, ids = to_views(model)
    np.testing.assert_allclose(views.K, first.K)
    assert not warnings
    # frames stored at half the size: the same rays, half the pixels
    half = FootageRecord(**{**footage(truth).__dict__, "cameras": (CameraRecord(0, (320, 240)),)})
    _, small, few, _ = import_sparse(tmp_path / "m", half)
    np.testing.assert_allclose(
        np.abs(residuals(small, few)).mean(),
        np.abs(residuals(first, to_points(model, ids))).mean() / 2,
        rtol=1e-6,
    )
    odd = FootageRecord(**{**footage(truth).__dict__, "cameras": (CameraRecord(0, (320, 320)),)})
    with pytest.raises(InputError, match="shape"):
        import_sparse(tmp_path / "m", odd)
    other = FootageRecord(**{**footage(truth).__dict__, "frames": (FrameRecord("cam0/x.png", 0, 0, 0),)})
    with pytest.raises(NotPossible, match="images are in the footage"):
        import_sparse(tmp_path / "m", other)


def test_import_without_a_model(tmp_path):
    from massprops.sfm.sparse_import import find_model

    with pytest.raises(InputError, match="no COLMAP model"):
        find_model(tmp_path)


def test_blank_images_are_refused(tmp_path):
    import cv2

    views, _ = scene.make(4, 5)
    (tmp_path / "frames" / "cam0").mkdir(parents=True)
    for name in views.names:
        cv2.imwrite(str(tmp_path / "frames" / name), np.zeros((480, 640), np.uint8))
    with pytest.raises(NotPossible, match="texture"):
        reconstruct.reconstruct(footage(views, tmp_path), tmp_path / "work")


def test_a_body_that_does_not_turn_is_refused(tmp_path):
    import cv2

    views, _ = scene.make(5, 5)
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (96, 128)).astype(np.float32), (0, 0), 2)
    texture = cv2.resize(np.clip((texture - 127) * 6 + 127, 0, 255).astype(np.uint8), (640, 480))
    (tmp_path / "frames" / "cam0").mkdir(parents=True)
    for name in views.names:
        image = np.clip(texture + rng.normal(0, 2, texture.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(tmp_path / "frames" / name), image)
    with pytest.raises(NotPossible, match="turns|parallax"):
        reconstruct.reconstruct(footage(views, tmp_path), tmp_path / "work")


def test_a_mask_of_another_size_is_refused(tmp_path):
    import cv2

    from massprops.sfm.features import read_mask

    views, _ = scene.make(1, 5)
    (tmp_path / "masks" / "cam0").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "masks" / f"{views.names[0]}.png"), np.full((100, 100), 255, np.uint8))
    with pytest.raises(InputError, match="100x100"):
        read_mask(footage(views, tmp_path), views.names[0], (640, 480))


def test_features_stay_on_the_object_and_unknown_counts_as_object():
    from massprops.sfm.features import FeatureOptions, extract, object_region

    rng = np.random.default_rng(0)
    image = np.kron(rng.integers(0, 255, (60, 80)), np.ones((8, 8))).astype(np.uint8)
    mask = np.zeros((480, 640), np.uint8)
    mask[100:300, 200:420] = 128
    region = object_region(mask, 2)
    xy, d = extract(image, region, FeatureOptions())
    assert len(xy) > 50 and d.dtype == np.uint8 and d.shape == (len(xy), 128)
    assert xy[:, 0].min() >= 197 and xy[:, 0].max() <= 423
    whole, _ = extract(image, None, FeatureOptions())
    # cutting the image moves no feature
    near = np.linalg.norm(whole[:, None, :2] - xy[None, :, :2], axis=2).min(0)
    assert np.median(near) < 0.05
    assert len(extract(image, np.zeros_like(region), FeatureOptions())[0]) == 0


def test_footage_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="missing"):
        read_footage(tmp_path)
    (tmp_path / "footage.json").write_text(json.dumps({"frames": []}))
    with pytest.raises(InputError, match="capture"):
        read_footage(tmp_path)


def test_a_second_camera_needs_its_mounting():
    from massprops.sfm.database import rig_pose

    T = np.eye(4)
    T[0, 3] = 0.5
    poses = rig_pose((CameraRecord(0, (640, 480)), CameraRecord(1, (640, 480), T_BS=T)))
    np.testing.assert_allclose(poses[1][:3, 3], [-0.5, 0, 0])
    with pytest.raises(InputError, match="T_BS"):
        rig_pose((CameraRecord(0, (640, 480)), CameraRecord(1, (640, 480))))


@pytest.mark.parametrize(
    ("first", "second", "steady", "tried", "placed"),
    [
        (64, 0, True, [30], 64),
        (33, 60, True, [30, 15], 60),
        (33, 60, False, [30, 15], 33),
        (50, 40, True, [30, 15], 50),
    ],
)
def test_lost_images_are_tried_again_with_fewer_points(monkeypatch, tmp_path, first, second, steady, tried, placed):
    asked = []

    def mapped(database, frames, out, options, total, progress):
        asked.append(options.least_inliers)
        number = first if len(asked) == 1 else second
        return [SimpleNamespace(num_reg_images=lambda: number)]

    monkeypatch.setattr(attempt, "map_images", mapped)
    monkeypatch.setattr(attempt, "steady", lambda *_: steady)
    shown = SimpleNamespace(folder=tmp_path)
    models = attempt.mapped(tmp_path, shown, tmp_path, MappingOptions(), 64, lambda *_: None)
    assert asked == tried
    assert models[0].num_reg_images() == placed


def test_a_part_linked_the_wrong_way_round_jumps():
    R = Rotation.from_euler("zyx", np.outer(np.arange(40), [5.0, 1.0, 0.5]), degrees=True).as_matrix()
    times = np.delete(np.arange(40), [11, 12, 30])
    assert largest_jump(R[times], times) < 0.2
    flipped = R.copy()
    flipped[20:] = flipped[20:] @ Rotation.from_euler("x", 25, degrees=True).as_matrix()
    assert largest_jump(flipped[times], times) > 1.5
    loose = R.copy()
    loose[20] = loose[20] @ Rotation.from_euler("x", 4, degrees=True).as_matrix()
    assert largest_jump(loose[times], times) < 1
    assert largest_jump(R[:2], times[:2]) == 0


def test_images_beyond_a_jump_are_left_to_the_next_round():
    R = Rotation.from_euler("zyx", np.outer(np.arange(40), [5.0, 1.0, 0.5]), degrees=True).as_matrix()
    times = np.arange(40)
    core = (times >= 18) & (times < 26)
    assert steady_stretch(R, times, core).all()
    jumps = R.copy()
    jumps[:6] = jumps[:6] @ Rotation.from_euler("x", 25, degrees=True).as_matrix()
    jumps[35:] = jumps[35:] @ Rotation.from_euler("y", 90, degrees=True).as_matrix()
    kept = np.flatnonzero(steady_stretch(jumps, times, core))
    assert 6 <= kept[0] <= 8 and 32 <= kept[-1] <= 34 and len(kept) == kept[-1] - kept[0] + 1
    # what was placed before stays
    assert steady_stretch(jumps, times, times < 8)[:8].all()
    assert [list(own) for own in stretches(R, times)] == [list(times)]
    longest = stretches(jumps, times)[0]
    assert 6 <= longest[0] <= 8 and 32 <= longest[-1] <= 34 and np.all(np.diff(longest) == 1)


def test_a_part_that_turns_back_is_a_stretch_of_its_own():
    """As where near is taken for far: every attitude is like its neighbours, and the rate has the wrong sign."""
    angle = np.concatenate([np.arange(24.0), 24.0 - np.arange(12.0)])
    R = Rotation.from_euler("zyx", np.outer(angle, [5.0, 1.0, 0.5]), degrees=True).as_matrix()
    first, second, *few = stretches(R, np.arange(36))
    assert first[0] == 0 and 20 <= first[-1] < 24 < second[0] <= 28 and second[-1] == 35
    assert sum(len(own) for own in few) <= 6


def test_an_imported_model_may_have_the_users_own_names():
    from massprops.sfm.sparse_import import _frame_names

    frames = tuple(
        FrameRecord(f"cam0/{stored}", 0, -1, i, source_name=name)
        for i, (stored, name) in enumerate(
            [("Photo_1.jpg", "Photo 1.jpg"), ("image.heic.png", "照片.heic"), ("b.jpg", "b.jpg")]
        )
    )
    record = FootageRecord(Path(), "", "images", "static", "still", False, (CameraRecord(0, (640, 480)),), frames)
    found = _frame_names(record, ("Photo 1.jpg", "照片.jpg", "cam0/b.jpg", "other.jpg"))
    assert found == {"Photo 1.jpg": "cam0/Photo_1.jpg", "照片.jpg": "cam0/image.heic.png", "cam0/b.jpg": "cam0/b.jpg"}
