"""Mass properties of solids whose integrals are known on paper."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

from massprops.dynamics.inertia import is_physical
from massprops.errors import InputError
from massprops.mass.integrals import greatest_length, mesh_integrals, offset_response, scale_integrals
from massprops.mass.properties import mass_properties, principal_frame
from massprops.mass.repair import repair


def rotations() -> list[np.ndarray]:
    """The 24 turns of a cube."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return found


def lopsided() -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(2)
    mesh.vertices = mesh.vertices * [1.0, 2.0, 3.0] + 0.3 * mesh.vertices[:, [1, 2, 0]] ** 2
    return mesh


def test_box_is_exact():
    p = mass_properties(trimesh.creation.box((2.0, 3.0, 5.0)), 7.0)
    mass = 7.0 * 30
    expected = mass / 12 * np.array([9 + 25, 4 + 25, 4 + 9])
    assert p.volume == pytest.approx(30, rel=1e-13)
    np.testing.assert_allclose(p.inertia, np.diag(expected), rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(p.principal_moments, np.sort(expected), rtol=1e-12)


def test_corner_tetrahedron_is_exact():
    mesh = trimesh.Trimesh(
        np.vstack([np.zeros(3), np.eye(3)]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], process=False
    )
    p = mass_properties(mesh, 6.0)
    np.testing.assert_allclose(p.center_of_mass, 0.25, rtol=1e-13)
    second = np.full((3, 3), 1 / 20) + np.eye(3) / 20 - 1 / 16
    np.testing.assert_allclose(p.inertia, np.trace(second) * np.eye(3) - second, rtol=1e-12)


@pytest.mark.parametrize("level", [4, 5])
def test_sphere_converges_with_second_order(level):
    error = 1 - mass_properties(trimesh.creation.icosphere(level)).volume / (4 / 3 * np.pi)
    finer = 1 - mass_properties(trimesh.creation.icosphere(level + 1)).volume / (4 / 3 * np.pi)
    assert error / finer == pytest.approx(4, rel=0.05)


def test_torus_agrees_with_formula():
    p = mass_properties(trimesh.creation.torus(3.0, 1.0, major_sections=400, minor_sections=400), 1.0)
    volume = 2 * np.pi**2 * 3
    axial, across = volume * (9 + 0.75), volume * (4.5 + 0.625)
    np.testing.assert_allclose(p.principal_moments, [across, across, axial], rtol=5e-4)


def test_agrees_with_trimesh():
    mesh = lopsided()
    mesh.density = 3.0
    p = mass_properties(mesh, 3.0)
    np.testing.assert_allclose(p.inertia, mesh.moment_inertia, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(p.center_of_mass, mesh.center_mass, atol=1e-11)


def test_far_from_the_origin_nothing_changes():
    mesh, far = lopsided(), lopsided()
    far.vertices += [1000.0, -500.0, 250.0]
    a, b = mass_properties(mesh), mass_properties(far)
    np.testing.assert_allclose(b.inertia, a.inertia, rtol=1e-6, atol=1e-6 * a.principal_moments[0])
    np.testing.assert_allclose(b.center_of_mass - a.center_of_mass, [1000, -500, 250], rtol=1e-10)


@pytest.mark.parametrize("turn", rotations())
def test_tensor_turns_with_the_body_and_the_sign_rule_holds(turn):
    mesh = lopsided()
    p = mass_properties(mesh)
    mesh.vertices = mesh.vertices @ turn.T
    q = mass_properties(mesh)
    np.testing.assert_allclose(q.inertia, turn @ p.inertia @ turn.T, atol=1e-9 * p.principal_moments[2])
    axes = q.principal_axes
    assert np.linalg.det(axes) == pytest.approx(1)
    for column in (0, 2):
        assert axes[np.argmax(np.abs(axes[:, column])), column] > 0
    np.testing.assert_allclose(
        axes @ np.diag(q.principal_moments) @ axes.T, q.inertia, atol=1e-9 * p.principal_moments[2]
    )
    np.testing.assert_allclose([q.k1, q.k2], [p.k1, p.k2], atol=1e-10)


def test_inertia_grows_with_the_fifth_power():
    mesh = lopsided()
    p = mass_properties(mesh)
    row = mesh_integrals(mesh.vertices, mesh.faces)
    mesh.vertices *= 1.7
    np.testing.assert_allclose(mass_properties(mesh).inertia, 1.7**5 * p.inertia, rtol=1e-11)
    np.testing.assert_allclose(scale_integrals(row, 1.7), mesh_integrals(mesh.vertices, mesh.faces), rtol=1e-10)


@pytest.mark.parametrize("moments", [(1, 1, 1), (1, 1, 2), (1, 2, 2)])
def test_equal_moments_get_one_frame(moments):
    diagonal = np.diag(np.array(moments, float))
    for turn in rotations():
        _, axes = principal_frame(turn @ diagonal @ turn.T)
        np.testing.assert_allclose(np.sort(np.abs(axes), axis=0), [[0] * 3, [0] * 3, [1] * 3], atol=1e-12)
        assert (axes[:, [0, 2]].sum(0) > 0).all() and np.linalg.det(axes) == pytest.approx(1)


def test_triangle_inequality():
    assert is_physical([1, 2, 3]) and not is_physical([1, 1, 3]) and not is_physical([-1, 2, 2])


def test_a_hole_is_refused_and_a_small_one_repaired():
    mesh = trimesh.creation.icosphere(4)
    holed = trimesh.Trimesh(mesh.vertices, mesh.faces[3:], process=False)
    with pytest.raises(InputError, match="has holes"):
        mass_properties(holed)
    fixed, notes = repair(holed)
    assert mass_properties(fixed).volume == pytest.approx(mass_properties(mesh).volume, rel=1e-3)
    assert "filled" in " ".join(notes)


def test_inside_out_and_large_holes_and_no_faces():
    box = trimesh.creation.box()
    box.invert()
    fixed, notes = repair(box)
    assert mass_properties(fixed).volume == pytest.approx(1) and notes
    open_box = trimesh.Trimesh(*[getattr(trimesh.creation.box(), k) for k in ("vertices", "faces")], process=False)
    open_box.update_faces(np.arange(len(open_box.faces)) > 1)
    with pytest.raises(InputError, match="%"):
        repair(open_box)
    with pytest.raises(InputError, match="no faces"):
        repair(trimesh.Trimesh(np.eye(3), np.zeros((0, 3), int)))


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan])
def test_density_must_be_positive(density):
    with pytest.raises(InputError, match="density"):
        mass_properties(trimesh.creation.box(), density)


def test_offset_response_is_the_derivative():
    mesh = trimesh.creation.icosphere(3, radius=2.0)
    step = 1e-5
    grown = mesh_integrals(mesh.vertices * (1 + step / 2.0), mesh.faces)
    before = mesh_integrals(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(
        offset_response(mesh.vertices, mesh.faces).sum(0), (grown - before) / step, rtol=0.01, atol=1e-3
    )


def test_greatest_length_of_a_box_is_its_diagonal():
    length, i, j = greatest_length(trimesh.creation.box((1, 2, 2)).vertices)
    assert length == pytest.approx(3) and i != j
