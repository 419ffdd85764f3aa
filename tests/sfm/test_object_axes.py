"""A published model whose images lie where they are about the object, after it was turned over in a room that stayed."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from massprops.sfm.convert import to_views
from massprops.sfm.object_axes import in_object_axes
from massprops.views import Views

TURN = Rotation.from_rotvec([2.9, 0.3, -0.2]).as_matrix()
SHIFT = np.array([0.4, -1.0, 0.3])


@pytest.fixture(scope="module")
def room() -> tuple[pycolmap.Reconstruction, Views]:
    """Ten images of one camera, every point seen by all; and the views, the last four moved with the object."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig = 1, 1
    options.num_frames_per_rig, options.num_points3D = 10, 60
    model = pycolmap.synthesize_dataset(options)
    views, _ = to_views(model)
    moved = views.take(np.arange(6, 10)).moved(TURN, SHIFT)
    return model, Views.joined([views.take(np.arange(6)), moved])


def _seen_by(model: pycolmap.Reconstruction, names: set[str]) -> pycolmap.Reconstruction:
    """A copy in which every third point is seen by the named images alone, every next one by the others, the rest by all."""
    out = pycolmap.Reconstruction(model)
    for k, number in enumerate(sorted(out.points3D)):
        for image_id, index in [(e.image_id, e.point2D_idx) for e in out.points3D[number].track.elements]:
            named = out.images[image_id].name in names
            if (k % 3 == 0 and not named) or (k % 3 == 1 and named):
                out.delete_observation(image_id, index)
    return out


def test_cameras_and_their_own_points_move_with_the_object(room: tuple[pycolmap.Reconstruction, Views]) -> None:
    model, views = room
    turned = set(views.names[6:])
    model = _seen_by(model, turned)
    out = in_object_axes(model, views)
    by_name = {image.name: image for image in out.images.values()}
    for i, name in enumerate(views.names):
        pose = by_name[name].cam_from_world().matrix()
        np.testing.assert_allclose(pose, np.column_stack([views.R[i], views.t[i]]), atol=1e-9)
    out.update_point_3d_errors()
    assert out.num_points3D() == model.num_points3D()
    assert max(p.error for p in out.points3D.values()) < 1e-6  # every point still lies where its images show it
    shared = sorted(model.points3D)[2]
    assert {out.images[e.image_id].name for e in out.points3D[shared].track.elements} == set(views.names[:6])
    own = sorted(model.points3D)[0]
    np.testing.assert_allclose(out.points3D[own].xyz, TURN @ model.points3D[own].xyz + SHIFT, atol=1e-9)


def test_images_of_a_placement_that_was_not_joined_are_left_out(room: tuple[pycolmap.Reconstruction, Views]) -> None:
    model, views = room
    out = in_object_axes(model, views.take(np.arange(6)))
    assert out.num_reg_images() == 6 and model.num_reg_images() == 10
    assert {out.images[i].name for i in out.reg_image_ids()} == set(views.names[:6])


def test_a_model_whose_images_were_not_moved_stays_as_it_is(room: tuple[pycolmap.Reconstruction, Views]) -> None:
    model, _ = room
    out = in_object_axes(model, to_views(model)[0])
    assert out.num_points3D() == model.num_points3D() and out.num_reg_images() == 10
    assert all(np.array_equal(out.points3D[k].xyz, p.xyz) for k, p in model.points3D.items())
