"""Bounds of what replicates move unmeasured sides by."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.mass.integrals import mesh_integrals, offset_response
from massprops.surface.fill_bounds import INWARD, beyond_bounds, thickness
from massprops.surface.refine import face_normals

SIZE = np.array([2.0, 1.0, 0.1])


class _Room:
    """Silhouettes that leave the same room everywhere."""

    pixel = 0.01

    def __init__(self, room: float) -> None:
        self._room = room

    def room(self, start: np.ndarray, direction: np.ndarray, reach: float) -> np.ndarray:
        return np.full(len(start), self._room)


@pytest.fixture(scope="module")
def plate() -> tuple[np.ndarray, np.ndarray]:
    """A plate, a tenth as thick as it is wide, cut into small triangles."""
    mesh = trimesh.creation.box(SIZE).subdivide().subdivide()
    return np.array(mesh.vertices), np.array(mesh.faces)


def _back(plate: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(1, f) an offset of one of the plate's back."""
    return (face_normals(*plate)[:, 2] < -0.9)[None].astype(float)


def test_a_plate_is_as_thick_under_each_face_as_it_is(plate):
    normal = face_normals(*plate)
    away = np.abs(normal) @ SIZE
    assert thickness(plate, np.arange(len(normal))) == pytest.approx(away, rel=2e-2)


def test_a_side_goes_to_the_middle_at_most(plate):
    drawn = np.array([[-0.02], [-0.5]])
    modes, response = _back(plate), offset_response(*plate)
    rows = mesh_integrals(*plate) + drawn @ (modes @ response)
    assert rows[1, 0] < 0.0  # the back went through the front
    rows -= beyond_bounds(plate, _Room(0.0), modes, drawn, response)
    assert rows[:, 0] == pytest.approx(np.prod(SIZE) * np.array([0.8, 1 - INWARD]), rel=1e-2)


def test_a_side_goes_out_as_far_as_silhouettes_leave_room(plate):
    drawn = np.array([[0.02], [0.5]])
    modes, response = _back(plate), offset_response(*plate)
    over = beyond_bounds(plate, _Room(0.05), modes, drawn, response)
    assert over[0] == pytest.approx(np.zeros(10), abs=1e-12)
    # the room, and a silhouette's margin of a pixel
    assert over[1, 0] == pytest.approx((0.5 - 0.06) * SIZE[0] * SIZE[1])


def test_silhouettes_that_say_nothing_bound_nothing(plate):
    drawn = np.array([[0.5]])
    over = beyond_bounds(plate, _Room(0.0), _back(plate), drawn, offset_response(*plate))
    assert over == pytest.approx(np.zeros((1, 10)), abs=1e-12)


def test_measured_faces_are_left_as_they_are(plate):
    drawn = np.full((3, 2), -5.0)
    modes = np.zeros((2, len(plate[1])))
    assert not beyond_bounds(plate, _Room(0.0), modes, drawn, offset_response(*plate)).any()
