"""Degenerate reconstructions never reach algebra: finite answers or `NotPossible` come out, never another error."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scene

from massprops.errors import InputError, NotPossible
from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord
from massprops.sfm.points import SparsePoints, project_camera
from massprops.sfm.sound import flat_remarks, flatness, require_sound, sound


def footage(views):
    frames = tuple(FrameRecord(n, 0, int(t), i) for i, (n, t) in enumerate(zip(views.names, views.timestamp_ns)))  # noqa: B905
    camera = CameraRecord(0, (640, 480))
    return FootageRecord(Path(), "", "video", "tumbling", "black", True, (camera,), frames)


def to_model(views, points):
    """The COLMAP model of arrays, as they are."""
    import pycolmap

    model = pycolmap.Reconstruction()
    K = views.K[0]
    params = [K[0, 0], K[0, 2] + 0.5, K[1, 2] + 0.5, views.distortion[0, 0]]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(camera_id=1, model="SIMPLE_RADIAL", width=640, height=480, params=params)
    )
    place = np.zeros(len(points.obs_view), int)
    for i, name in enumerate(views.names):
        own = np.flatnonzero(points.obs_view == i)
        place[own] = np.arange(len(own))
        pose = pycolmap.Rigid3d(np.column_stack([views.R[i], views.t[i]]))
        image = pycolmap.Image(name=name, camera_id=1, image_id=i + 1, keypoints=points.obs_uv[own] + 0.5)
        model.add_image_with_trivial_frame(image, pose)
    for p, xyz in enumerate(points.xyz):
        track = pycolmap.Track()
        for k in np.flatnonzero(points.obs_point == p):
            track.add_element(int(points.obs_view[k]) + 1, int(place[k]))
        if len(track.elements):
            model.add_point3D(xyz, track)
    return model


def spoilt(kind, rng, views, points):
    """A reconstruction in which one thing, or all, is degenerate."""
    xyz, R, t, K, D = points.xyz.copy(), views.R.copy(), views.t.copy(), views.K.copy(), views.distortion.copy()
    keep = np.ones(len(points.obs_view), bool)
    n, m = len(views), len(xyz)
    if kind == "points at infinity":
        xyz[rng.random(m) < 0.5] *= 10.0 ** rng.integers(4, 200)
    elif kind == "no numbers":
        xyz[rng.random(m) < 0.3] = rng.choice([np.nan, np.inf])
    elif kind == "cameras at infinity":
        t[rng.random(n) < 0.4] *= 10.0 ** rng.integers(4, 200)
    elif kind == "all cameras at infinity":
        t *= 10.0 ** rng.integers(5, 12)
    elif kind == "poses without numbers":
        t[rng.integers(n)] = np.nan
    elif kind == "one place":
        t = -np.einsum("nij,j->ni", R, [0.0, 0.0, -8.0])
    elif kind == "points on the cameras":
        xyz = views.centres[rng.integers(n, size=m)]
    elif kind == "two rays":
        keep = rng.random(len(keep)) < 1.5 / n
    elif kind == "a plane":
        xyz[:, 2] = 0.3 * xyz[:, 0]
    elif kind == "a line":
        xyz[:, 1:] = 0.0
    elif kind == "one point":
        xyz[:] = xyz[0]
    elif kind == "a focal length at its bound":
        K[:, [0, 1], [0, 1]] = rng.choice([1e-12, 5.0, 6500.0, 1e9, -800.0, np.nan])
    elif kind == "a wild lens":
        D[:, 0] = rng.choice([1e9, -1e3, np.nan, np.inf])
    elif kind == "few images":
        keep = points.obs_view < rng.integers(1, 4)
    elif kind == "nothing":
        keep[:] = False
    elif kind == "mirrored":
        xyz = -xyz
    elif kind == "huge":
        xyz, t = xyz * 1e120, t * 1e120
    elif kind == "tiny":
        xyz, t = xyz * 1e-120, t * 1e-120
    elif kind == "noise":
        xyz = rng.normal(size=xyz.shape) * 10.0 ** rng.integers(-3, 5)
        t = rng.normal(size=t.shape) * 10.0 ** rng.integers(-3, 5)
    return replace(views, R=R, t=t, K=K, distortion=D), replace(points, xyz=xyz).observed(keep)


KINDS = (
    "points at infinity", "no numbers", "cameras at infinity", "all cameras at infinity", "poses without numbers",
    "one place", "points on the cameras", "two rays", "a plane", "a line", "one point", "a focal length at its bound",
    "a wild lens", "few images", "nothing", "mirrored", "huge", "tiny", "noise", "as it was",
)  # fmt: skip


def finite(views, points, accuracy):
    for a in (views.K, views.distortion, views.R, views.t, points.xyz, points.obs_uv):
        assert np.isfinite(a).all()
    assert np.isfinite(accuracy.rms_px)
    assert not np.isinf(accuracy.attitude).any()
    assert len(views) >= 3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_adjustment_gives_finite_answers_or_says_why_not(kind, seed):
    from massprops.sfm.attempt import SfmOptions
    from massprops.sfm.last_adjustment import finish
    from massprops.sfm.mapping import MappingOptions, quiet

    quiet()
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    good = scene.make(6, 40, noise=0.2, seed=seed)
    views, points = spoilt(kind, rng, *good)
    model = to_model(views, points)
    given = bool(rng.integers(2))
    try:
        result = finish(
            model, footage(views), MappingOptions(fixed_intrinsics=given), SfmOptions(threads=1), ((6, 40),), []
        )
    except NotPossible as error:
        assert kind != "as it was"
        assert len(str(error)) > 60 and "array" not in str(error)
    else:
        finite(result.views, result.points, result.precision)


@pytest.mark.parametrize("kind", KINDS)
def test_an_import_gives_finite_answers_or_says_why_not(kind, tmp_path):
    from massprops.sfm.precision import precision
    from massprops.sfm.sparse_import import import_sparse

    rng = np.random.default_rng(KINDS.index(kind))
    views, points = spoilt(kind, rng, *scene.make(6, 40, noise=0.2))
    (tmp_path / "sparse").mkdir()
    to_model(views, points).write(tmp_path / "sparse")
    try:
        _, found, seen, _ = import_sparse(tmp_path, footage(views))
    except (NotPossible, InputError) as error:
        assert kind != "as it was"
        assert "array" not in str(error)
        return
    accuracy = precision(found, seen, True, 0, 1.0)
    for a in (found.K, found.R, found.t, seen.xyz, seen.obs_uv):
        assert np.isfinite(a).all()
    assert len(found) >= 3
    assert not np.isinf(accuracy.attitude).any()


def test_only_what_is_degenerate_is_taken_out():
    views, points = scene.make(8, 60, noise=0.2)
    whole = sound(views, points)
    assert whole.views.all() and whole.observations.all()
    xyz, t = points.xyz.copy(), views.t.copy()
    xyz[:5] *= 1e7
    t[2] = [0, 0, 1e6]
    found = sound(replace(views, t=t), replace(points, xyz=xyz))
    np.testing.assert_array_equal(found.views, np.arange(8) != 2)
    np.testing.assert_array_equal(found.observations, (points.obs_point >= 5) & (points.obs_view != 2))


def test_a_point_within_a_camera_is_none() -> None:
    """However well other images agree: a step of 1e-6 before a lens moves it by all of the image."""
    views, points = scene.make(8, 60, noise=0.2)
    xyz, uv = points.xyz.copy(), points.obs_uv.copy()
    xyz[0] = views.centres[0] + 1e-6 * views.R[0][2]
    camera = np.einsum("nij,j->ni", views.R, xyz[0]) + views.t
    seen = points.obs_point == 0
    uv[seen] = project_camera(views.K, views.distortion, camera)[points.obs_view[seen]]
    found = sound(views, replace(points, xyz=xyz, obs_uv=uv), given_focal=True, given_poses=True)
    assert found.views.all() and not found.observations[seen & (points.obs_view == 0)].any()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda v, p: (replace(v, K=v.K * [[[20.0], [20.0], [1.0]]]), p), "focal length .* bound.*--focal"),
        (
            lambda v, p: (replace(v, K=v.K * [[[0.13], [0.13], [1.0]]] * v.size.max() / v.K[0, 0, 0]), p),
            "focal length .* bound",
        ),
        (lambda v, p: (replace(v, R=v.R[:1].repeat(8, 0), t=v.t[:1].repeat(8, 0)), p), "no parallax"),
        (lambda v, p: (v, p.observed(p.obs_view < 2)), "only 0 of 8 images hold together"),
        (lambda v, p: (v.take(np.arange(0)), p.observed(p.obs_view < 0)), "^no three images hold together: they share"),
    ],
)
def test_the_footage_is_named_as_the_reason(spoil, said):
    with pytest.raises(NotPossible, match=said):
        require_sound(sound(*spoil(*scene.make(8, 60))))


def test_a_plane_alone_needs_a_focal_length():
    _, points = scene.make(8, 60)
    plane = replace(points, xyz=points.xyz * [1, 1, 0])
    assert flatness(points) > 0.3 and flatness(plane) < 1e-9
    assert flat_remarks(points, np.nan) == []
    assert "plane" in flat_remarks(plane, 0.01)[0]
    for sigma in (0.5, np.nan, np.inf):
        with pytest.raises(NotPossible, match="one plane.*--focal"):
            flat_remarks(plane, sigma)


def test_a_model_without_points_keeps_its_poses(tmp_path):
    from massprops.sfm.sparse_import import import_sparse

    views, points = scene.make(6, 40)
    (tmp_path / "sparse").mkdir()
    to_model(views, points.observed(np.zeros(len(points.obs_view), bool))).write(tmp_path / "sparse")
    _, found, seen, warnings = import_sparse(tmp_path, footage(views))
    np.testing.assert_allclose(found.R, views.R, atol=1e-9)
    assert isinstance(seen, SparsePoints) and len(seen.xyz) == 0 and not warnings
