"""Pieces of a textured sphere followed from view to view, and the adjustment that uses them."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap

import numpy as np
from scipy.spatial.transform import Rotation
from test_dense import SIZE, sphere_views

from massprops.views import Views


def turned(views: Views, degrees: float, seed: int = 0) -> Views:
    """The views with attitudes wrong by `degrees` (root mean square), each about the body's origin."""
    rng = np.random.default_rng(seed)
    wrong = Rotation.from_rotvec(np.radians(degrees) * rng.standard_normal((len(views), 3)) / np.sqrt(3)).as_matrix()
    return Views(
        views.names, views.timestamp_ns, views.size, views.K, views.distortion,
        np.einsum("nij,njk->nik", views.R, wrong), views.t,
    )  # fmt: skip


def attitude_error(found: Views, truth: Views) -> float:
    """Root mean square angle [deg] after the best common rotation of the world."""
    common = Rotation.from_matrix(np.einsum("nji,njk->nik", truth.R, found.R)).mean().as_matrix()
    off = Rotation.from_matrix(np.einsum("nij,jk,nlk->nil", truth.R, common, found.R)).magnitude()
    return float(np.degrees(np.sqrt(np.mean(off**2))))


def test_pieces_are_found_where_they_are_and_not_where_the_poses_say():
    from massprops.sfm.patches import Pictures, follow

    views, images, *_ = sphere_views(7, noise=0.0)
    wrong = turned(views, 0.5)
    xyz = np.random.default_rng(1).standard_normal((400, 3))
    xyz /= np.linalg.norm(xyz, axis=1, keepdims=True)
    xyz = xyz[np.einsum("ij,j->i", xyz, views.centres[3] / np.linalg.norm(views.centres[3])) > 0.6]
    K = np.stack([views.K[:, 0, 0], views.K[:, 1, 1], views.K[:, 0, 2], views.K[:, 1, 2]], axis=1)
    grey = np.stack([i[0][..., 0] for i in images])
    mask = np.stack([i[1] for i in images])
    # the home view is right, so that the pieces in it are the right ones
    R, t = wrong.R.copy(), wrong.t.copy()
    R[3], t[3] = views.R[3], views.t[3]
    point = np.repeat(np.arange(len(xyz)), 2)
    view = np.tile([2, 4], len(xyz))
    pictures = Pictures(grey, mask, views.size, K)
    found = follow(point, np.full(len(point), 3), view, (xyz, xyz), (R, t), pictures, 1 / 12.0)
    good = found[:, 2] > 0.8
    assert good.mean() > 0.5

    def at(R):
        c = np.einsum("kij,kj->ki", R[view], xyz[point]) + views.t[view]
        return c[:, :2] / c[:, 2:] * K[view, :2] + K[view, 2:]

    off = np.linalg.norm(found[:, :2] - at(views.R), axis=1)[good]
    told = np.linalg.norm(found[:, :2] - at(R), axis=1)[good]
    assert np.median(off) < 0.1
    assert np.median(told) > 3 * np.median(off)


def sphere_model(views: Views, xyz: np.ndarray, view: np.ndarray, point: np.ndarray, noise: float):
    """A COLMAP model with noisy observations of sparse points."""
    import pycolmap

    rng = np.random.default_rng(3)
    c = np.einsum("kij,kj->ki", views.R[view], xyz[point]) + views.t[view]
    K = views.K[0]
    uv = c[:, :2] / c[:, 2:] * K[0, 0] + K[:2, 2] + 0.5 + noise * rng.standard_normal((len(view), 2))
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1, model="SIMPLE_RADIAL", width=SIZE, height=SIZE,
            params=[K[0, 0], K[0, 2] + 0.5, K[1, 2] + 0.5, 0.0],
        )
    )  # fmt: skip
    tracks = [pycolmap.Track() for _ in xyz]
    for i, name in enumerate(views.names):
        own = np.flatnonzero(view == i)
        for k, o in enumerate(own):
            tracks[point[o]].add_element(i + 1, k)
        image = pycolmap.Image(name=name, camera_id=1, image_id=i + 1, keypoints=uv[own])
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(views.R[i]), views.t[i]))
    for x, track in zip(xyz, tracks, strict=True):
        if track.length() >= 3:
            model.add_point3D(x, track)
    return model


def test_tracks_of_the_surface_mend_attitudes_and_leave_the_models_points():
    from massprops.sfm.convert import to_views
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import Effort, RefineOptions, adjust, honest, model_precision
    from massprops.sfm.surface_tracks import PIXELS, with_surface

    quiet()
    views, images, (xyz, view, point) = sphere_views(9)
    few = point < 60
    model = sphere_model(views, xyz, view[few], point[few], 0.6)
    options = RefineOptions()
    adjust(model, False, False, 0.5, 1, Effort())
    before = honest(model_precision(model, False, 0, 0.5))
    was, count = attitude_error(to_views(model)[0], views), model.num_points3D()
    after = with_surface(model, before, lambda i: images[i], options, False, False, PIXELS, 0, 1).precision
    found = to_views(model)[0]
    assert attitude_error(found, views) < 0.5 * was
    assert np.median(after.attitude) < np.median(before.attitude)
    assert model.num_points3D() == count
    # the same again, to the last digit
    again = sphere_model(views, xyz, view[few], point[few], 0.6)
    adjust(again, False, False, 0.5, 1, Effort())
    with_surface(again, before, lambda i: images[i], options, False, False, PIXELS, 0, 1)
    np.testing.assert_array_equal(found.R, to_views(again)[0].R)


def test_without_texture_the_model_stays():
    from massprops.sfm.convert import to_views
    from massprops.sfm.refine import RefineOptions, honest, model_precision
    from massprops.sfm.surface_tracks import PIXELS, with_surface

    views, images, (xyz, view, point) = sphere_views(9, flat=True)
    model = sphere_model(views, xyz, view, point, 0.3)
    before = honest(model_precision(model, False, 0, 0.5))
    found = with_surface(model, before, lambda i: images[i], RefineOptions(), False, False, PIXELS, 0, 1)
    assert found.precision is before and found.pieces is None
    np.testing.assert_allclose(to_views(model)[0].R, views.R, atol=1e-12)
