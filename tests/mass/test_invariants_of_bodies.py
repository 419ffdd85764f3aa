"""What holds of mass properties and of the logarithm of an inertia whatever the body is."""

from __future__ import annotations

import numpy as np
import trimesh
from drawn import arrays, inertias, matrices, quickly, rotations
from hypothesis import given
from hypothesis import strategies as st

from massprops.mass.integrals import (
    central_inertia,
    centroid,
    face_areas,
    greatest_length,
    mesh_integrals,
    scale_integrals,
    shift_integrals,
)
from massprops.mass.properties import principal_frame
from massprops.mass.ratio_space import chi_square, inertia_of, log_components, p_value, turn_between


@st.composite
def hulls(draw: st.DrawFn) -> trimesh.Trimesh:
    """Convex bodies about a tetrahedron, so that none is flat."""
    cloud = np.vstack([draw(arrays((6, 3), 2.0)), np.eye(3), [[-1.0, -1.0, -1.0]]])
    return trimesh.convex.convex_hull(cloud)


@quickly
@given(hulls(), rotations(), arrays(3), st.floats(0.1, 10.0))
def test_integrals_move_turn_and_grow_with_the_body(
    body: trimesh.Trimesh, R: np.ndarray, shift: np.ndarray, factor: float
) -> None:
    v, f = np.asarray(body.vertices), np.asarray(body.faces)
    row = mesh_integrals(v, f)
    size = np.abs(row).max() * max(1.0, np.abs(shift).max()) ** 2
    np.testing.assert_allclose(mesh_integrals(v + shift, f), shift_integrals(row, shift), atol=1e-9 * size)
    np.testing.assert_allclose(shift_integrals(shift_integrals(row, shift), -shift), row, atol=1e-9 * size)
    np.testing.assert_allclose(mesh_integrals(factor * v, f), scale_integrals(row, factor), rtol=1e-6, atol=1e-9)
    mass, centre, inertia = central_inertia(row, 2.0)
    turned = central_inertia(mesh_integrals(v @ R.T, f), 2.0)
    assert np.isclose(turned[0], mass) and mass > 0
    np.testing.assert_allclose(turned[1], R @ centre, atol=1e-9)
    np.testing.assert_allclose(turned[2], R @ inertia @ R.T, atol=1e-7 * np.trace(inertia))
    assert body.convex_hull.contains([centroid(v, f)])[0]


@quickly
@given(hulls(), rotations())
def test_areas_and_the_greatest_length_stay_when_a_body_turns(body: trimesh.Trimesh, R: np.ndarray) -> None:
    v, f = np.asarray(body.vertices), np.asarray(body.faces)
    np.testing.assert_allclose(face_areas(v @ R.T, f), face_areas(v, f), atol=1e-12)
    length, i, j = greatest_length(v)
    assert np.isclose(length, np.linalg.norm(v[i] - v[j]))
    assert np.isclose(length, np.linalg.norm(v[:, None] - v[None], axis=2).max())
    assert np.isclose(greatest_length(v @ R.T)[0], length)


@quickly
@given(inertias())
def test_the_principal_frame_is_right_handed_and_keeps_its_rule_of_signs(inertia: np.ndarray) -> None:
    moments, axes = principal_frame(inertia)
    assert np.all(np.diff(moments) >= 0) and np.isclose(np.linalg.det(axes), 1.0)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, atol=1e-6)
    for column in (0, 2):
        assert axes[np.argmax(np.round(np.abs(axes[:, column]), 9)), column] > 0


@quickly
@given(arrays(2, 1.0), rotations(), rotations())
def test_the_logarithm_of_an_inertia_holds_its_ratios(k: np.ndarray, P: np.ndarray, R: np.ndarray) -> None:
    k = -np.abs(k)
    inertia = inertia_of(k, P)
    assert np.isclose(np.trace(inertia), 1.0)
    five = log_components(inertia, P)
    np.testing.assert_allclose(five, [*k, 0, 0, 0], atol=1e-7)
    np.testing.assert_allclose(log_components(9.0 * inertia, P), five, atol=1e-7)
    np.testing.assert_allclose(log_components(R @ inertia @ R.T, R @ P), five, atol=1e-7)


@quickly
@given(rotations(), arrays(3, 0.3), st.sampled_from([(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]))
def test_a_turn_between_frames_does_not_mind_the_signs_of_axes(P: np.ndarray, turn: np.ndarray, sign: tuple) -> None:
    from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix

    moved = P @ rotation_matrix(from_rotation_vector(turn)) * np.array(sign)
    np.testing.assert_allclose(turn_between(moved, P), turn, atol=1e-7)


@quickly
@given(matrices(3), arrays(3), st.floats(1.0, 3.0))
def test_a_larger_difference_is_less_likely(P: np.ndarray, e: np.ndarray, factor: float) -> None:
    difference = e * np.sqrt(np.diag(P))
    near, degrees = chi_square(difference, P)
    far, _ = chi_square(factor * difference, P)
    assert 0.0 <= near <= far * (1 + 1e-9) and degrees <= 3
    assert 0.0 <= p_value(far, degrees) <= p_value(near, degrees) <= 1.0
