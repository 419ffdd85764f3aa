"""What an underside that nobody saw may hide."""

import numpy as np
import pytest
import trimesh

from massprops.mass.confidence import Evidence, ImageEvidence, PlacementEvidence, SurfaceEvidence, confidence
from massprops.mass.integrals import mesh_integrals
from massprops.mass.intervals import valid_bodies
from massprops.surface.hollow import hollowed, hollows, wall_thickness, water_held

TURN = trimesh.transformations.random_rotation_matrix(np.random.default_rng(0).random(3))[:3, :3]
SHIFT = np.array([0.3, 2.0, -1.0])
PLANE = np.append(TURN[:, 2], -TURN[:, 2] @ SHIFT)
EDGE = 0.12


def turned_body(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A body of revolution with the profile (radius, height) on the plane: vertices, faces, and what is seen from above
    and from the sides."""
    mesh = trimesh.creation.revolve(np.array(profile), sections=60).subdivide_to_size(EDGE)
    mesh.fix_normals()
    seen = ~((mesh.face_normals[:, 2] < -0.5) & (mesh.triangles_center[:, 2] < 1e-6))
    return mesh.vertices @ TURN.T + SHIFT, mesh.faces, seen


def shares(profile: list[tuple[float, float]], noise: float = 0.01) -> tuple[float, float]:
    """Possible and likely hollows over the volume."""
    vertices, faces, seen = turned_body(profile)
    found = hollows(vertices, faces, seen, PLANE, noise, EDGE / 16)
    volume = mesh_integrals(vertices, faces)[0]
    return found.possible[0] / volume, found.likely[0] / volume


DRUM = [(0, 0), (1, 0), (1, 1), (0, 1)]
THICK_DISH = [(0, 0), (1.2, 0), (1.2, 0.3), (1.15, 0.3), (0.75, 0.1), (0, 0.1)]
CUP = [(0, 0), (1, 0), (1, 1.5), (0.9, 1.5), (0.9, 0.5), (0, 0.5)]


def test_nothing_speaks_for_a_hollow_below_a_side_that_bulges():
    assert shares(DRUM)[1] == 0


def test_a_dish_may_be_a_thin_sheet():
    possible, likely = shares(THICK_DISH)
    assert likely == possible > 0.6


def test_a_cup_keeps_the_wall_that_was_seen_from_both_sides():
    vertices, faces, seen = turned_body(CUP)
    assert wall_thickness(vertices, faces[seen]) == pytest.approx(0.1, rel=0.15)
    volume = mesh_integrals(vertices, faces)[0]
    found = hollows(vertices, faces, seen, PLANE, 0.005, EDGE / 16)
    # below its floor of 0.5 all but a wall's thickness, and nothing of the wall itself
    wall = np.pi * (1 - 0.9**2) * 1.0
    floor = np.pi * 0.9**2 * 0.4
    assert found.likely[0] == pytest.approx(floor, rel=0.15)
    assert volume - found.possible[0] > wall


def test_where_a_hollow_is_known_of_walls_are_not_as_thick_as_those_that_were_seen():
    """As of a toy car: its wheels were seen from both sides, and its body is a shell open below."""
    wheel = [(0, 0), (1, 0), (1, 1.5), (0.6, 1.5), (0.6, 0.7), (0, 0.7)]
    vertices, faces, seen = turned_body(wheel)
    volume = mesh_integrals(vertices, faces)[0]
    alike, thin = (
        hollows(vertices, faces, seen, PLANE, 0.01, EDGE / 16, walls_alike=w).possible[0] / volume
        for w in (True, False)
    )
    assert alike < 0.5 < 0.9 < thin


def test_water_stands_in_a_cup_and_not_on_a_drum():
    held = [water_held(*turned_body(p)[:2], PLANE, EDGE / 16) for p in (CUP, DRUM)]
    assert held[0] == pytest.approx(np.pi * 0.9**2 * 1.0, rel=0.05) and held[1] == 0


def test_what_is_left_without_the_hollow_is_the_sheet():
    vertices, faces, seen = turned_body(THICK_DISH)
    body = mesh_integrals(vertices, faces)
    found = hollows(vertices, faces, seen, PLANE, 0.005, EDGE / 16)
    left = body - found.likely
    assert valid_bodies(left[None]).all()
    # the hollow lies below: what is left has its centre higher
    height = [(r[1:4] / r[0]) @ PLANE[:3] + PLANE[3] for r in (body, left)]
    assert height[1] > height[0]


def test_replicates_reach_from_all_to_nothing_of_the_hollow():
    vertices, faces, seen = turned_body(THICK_DISH)
    body = mesh_integrals(vertices, faces)
    space = hollows(vertices, faces, seen, PLANE, 0.005, EDGE / 16).likely
    rows = hollowed(np.tile(body, (2000, 1)), body, space, 0)
    assert np.quantile(rows[:, 0], 0.05) < body[0] - 0.95 * space[0]
    assert np.quantile(rows[:, 0], 0.95) > body[0] - 0.05 * space[0]
    assert valid_bodies(rows).mean() > 0.99


def test_where_nothing_can_be_hollow_replicates_stay():
    rows = np.random.default_rng(0).random((5, 10))
    assert np.allclose(hollowed(rows, rows[0] + 1, np.zeros(10), 0), rows)


def test_the_confidence_says_what_was_not_seen():
    surface, images = SurfaceEvidence(half_width=0.01, filled=0.0, inferred=0.1), ImageEvidence(given=40, used=40)
    vessel = confidence(Evidence(surface, images, PlacementEvidence(hollow_possible=0.8, hollow_likely=0.7)))
    drum = confidence(Evidence(surface, images, PlacementEvidence(hollow_possible=0.8)))
    assert "70 % less volume" in vessel["because"][-1]
    assert "80 % less" in drum["because"][-1] and drum["level"] == "high"
