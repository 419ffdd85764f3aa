"""How far a surface may be off where nothing was measured."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.surface.error_modes import COMMON, PLANE_PIXELS, RECESS, fill_modes, underside_modes


@pytest.mark.parametrize("thickness", [0.01, 0.04])
def test_the_front_of_a_plate_does_not_tell_where_its_back_is(thickness: float) -> None:
    """The back of an array that was never lit came out 0.05 m off, where its front, 0.05 m away, had been measured."""
    plate = trimesh.creation.box((1.0, 0.6, thickness)).subdivide_to_size(0.05)
    vertices, faces = np.asarray(plate.vertices), np.asarray(plate.faces)
    normal, middle = plate.face_normals, plate.triangles_center
    rim = (np.abs(middle[:, :2]) > np.array([0.45, 0.25])).any(1)
    back = (normal[:, 2] < -0.9) & ~rim
    off = fill_modes(vertices, faces, ~back, 1.0)[0, back] / COMMON
    to_rim = (np.array([0.45, 0.25]) - np.abs(middle[back, :2])).min(axis=1)
    assert np.all(off > to_rim) and np.all(off < to_rim + 0.06)


def test_fill_with_nothing_measured_that_looks_its_way_is_as_far_as_the_nearest() -> None:
    box = trimesh.creation.box((1.0, 1.0, 1.0)).subdivide_to_size(0.1)
    seen = box.face_normals[:, 2] > 0.9
    off = fill_modes(np.asarray(box.vertices), np.asarray(box.faces), seen, 1.0)[0] / COMMON
    assert np.all(off[seen] == 0.0) and np.isclose(off.max(), 1.0, atol=0.02)


def test_an_underside_is_as_far_in_as_it_reaches_from_the_rim_and_as_far_off_as_its_plane() -> None:
    box = trimesh.creation.box((1.0, 1.0, 0.6)).subdivide_to_size(0.05)
    mesh, below = (np.asarray(box.vertices), np.asarray(box.faces)), box.face_normals[:, 2] < -0.9
    recess, plane = underside_modes(*mesh, ~below, below, 0.02)
    to_rim = 0.5 - np.abs(box.triangles_center[below, :2]).max(axis=1)
    assert np.all(np.abs(recess[below] / RECESS - to_rim) < 0.06) and not recess[~below].any()
    np.testing.assert_allclose(plane, np.where(below, 0.02 * PLANE_PIXELS, 0.0))
    assert len(fill_modes(*mesh, ~below, 1.0, below)) == 0, "nothing of it is a fill"
    assert len(underside_modes(*mesh, ~below, np.zeros(len(below), bool), 0.02)) == 0
