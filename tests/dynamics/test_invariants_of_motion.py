"""What holds of turns, inertias, orbits and free motion whatever the numbers are."""

from __future__ import annotations

import numpy as np
from drawn import arrays, inertias, numbers, quickly, rotations, turns
from hypothesis import given
from hypothesis import strategies as st

from massprops.dynamics import inertia as algebra
from massprops.dynamics import kernels
from massprops.dynamics.alignment import horn, similarity
from massprops.dynamics.linear_recurrence import recurrence
from massprops.dynamics.orbit import eccentric_anomaly, lvlh_axes, position_velocity
from massprops.dynamics.quaternion import (
    angle_between,
    chained,
    conjugate,
    from_rotation_matrix,
    from_rotation_vector,
    mean_quaternion,
    multiply,
    nearest_rotation,
    rotate,
    rotation_matrix,
    rotation_vector,
)
from massprops.dynamics.rigid_body import angular_momentum, kinetic_energy, propagate
from massprops.sequence import Orbit

EARTH = 3.986004418e14


@quickly
@given(turns(), turns(), arrays(3))
def test_a_product_of_turns_turns_by_one_after_the_other(p: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
    assert np.isclose(np.linalg.norm(multiply(p, q)), 1.0)
    np.testing.assert_allclose(rotate(multiply(p, q), v), rotate(p, rotate(q, v)), atol=1e-12)
    np.testing.assert_allclose(rotation_matrix(q) @ v, rotate(q, v), atol=1e-12)
    np.testing.assert_allclose(rotate(conjugate(q), rotate(q, v)), v, atol=1e-12)
    assert np.isclose(np.linalg.norm(rotate(q, v)), np.linalg.norm(v))


@quickly
@given(turns())
def test_a_turn_comes_back_from_its_matrix_and_from_its_vector(q: np.ndarray) -> None:
    for back in (from_rotation_matrix(rotation_matrix(q)), from_rotation_vector(rotation_vector(q))):
        assert angle_between(back, q) < 1e-7
    assert np.linalg.norm(rotation_vector(q)) <= np.pi + 1e-12
    assert angle_between(mean_quaternion(np.stack([q, -q, q])), q) < 1e-7


@quickly
@given(arrays((3, 3), 1.0))
def test_the_nearest_rotation_is_one_and_is_its_own(M: np.ndarray) -> None:
    R = nearest_rotation(M)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.isclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(nearest_rotation(R), R, atol=1e-12)


@quickly
@given(arrays((5, 3), 1.0))
def test_a_chain_of_turns_undone_one_by_one_gives_them_back(v: np.ndarray) -> None:
    q = chained(v)
    np.testing.assert_allclose(rotation_vector(multiply(conjugate(q[:-1]), q[1:])), v, atol=1e-9)


@quickly
@given(inertias(), rotations())
def test_ratios_and_moments_do_not_depend_on_the_axes_nor_on_the_scale(I: np.ndarray, R: np.ndarray) -> None:
    k, axes = algebra.ratios(I)
    np.testing.assert_allclose(algebra.ratios(7.0 * R @ I @ R.T)[0], k, atol=1e-10)
    assert (k <= 1e-12).all() and np.isclose(np.linalg.det(axes), 1.0)
    np.testing.assert_allclose(axes @ np.diag(algebra.principal_axes(I)[0]) @ axes.T, I, atol=1e-12)
    assert algebra.is_physical(algebra.principal_axes(I)[0])


@quickly
@given(arrays((3, 3), 3.0), rotations())
def test_the_nearest_body_can_be_and_turns_with_its_axes(M: np.ndarray, R: np.ndarray) -> None:
    near = algebra.project_to_physical(M + M.T)
    assert algebra.is_physical(np.linalg.eigvalsh(near)) and np.isclose(np.trace(near), 1.0)
    np.testing.assert_allclose(algebra.project_to_physical(near), near, atol=1e-12)
    np.testing.assert_allclose(algebra.project_to_physical(R @ (M + M.T) @ R.T), R @ near @ R.T, atol=1e-6)


@quickly
@given(arrays(5, 2.0))
def test_five_numbers_come_back_from_their_inertia(five: np.ndarray) -> None:
    I = algebra.cholesky_inertia(five)
    assert np.isclose(np.trace(I), 1.0) and np.linalg.eigvalsh(I).min() > 0
    np.testing.assert_allclose(algebra.cholesky_parameters(I), five, atol=1e-6)


@quickly
@given(inertias(), arrays(3, 2.0))
def test_a_symmetric_system_is_solved(I: np.ndarray, x: np.ndarray) -> None:
    six = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    np.testing.assert_allclose(kernels.symmetric_times(*six, *x), I @ x, atol=1e-13)
    np.testing.assert_allclose(kernels.symmetric_solve(*six, *(I @ x)), x, atol=1e-9)


@quickly
@given(turns(), turns())
def test_a_turn_between_two_attitudes_leads_from_one_to_the_other(q: np.ndarray, p: np.ndarray) -> None:
    assert angle_between(np.array(kernels.turned(*q, *kernels.turn_between(*q, *p))), p) < 1e-7


@quickly
@given(inertias(), arrays(3, 0.5), turns(), rotations())
def test_free_motion_keeps_momentum_and_energy_in_any_body_axes(
    I: np.ndarray, w0: np.ndarray, q0: np.ndarray, R: np.ndarray
) -> None:
    times = np.linspace(0.0, 5.0, 6)
    q, w = propagate(q0, w0, I, times)
    momentum, energy = angular_momentum(q, w, I), kinetic_energy(w, I)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-6)
    np.testing.assert_allclose(energy, energy[0], atol=1e-6)
    other = propagate(multiply(q0, from_rotation_matrix(R.T)), R @ w0, R @ I @ R.T, times)[1]
    np.testing.assert_allclose(other, w @ R.T, atol=1e-6)


@quickly
@given(arrays(4, 30.0), st.floats(0.0, 0.95))
def test_the_equation_of_kepler_is_solved_and_goes_up_by_whole_turns(mean: np.ndarray, e: float) -> None:
    E = eccentric_anomaly(mean, e)
    np.testing.assert_allclose(E - e * np.sin(E), mean, atol=1e-9)
    np.testing.assert_allclose(eccentric_anomaly(mean + 2 * np.pi, e), E + 2 * np.pi, atol=1e-6)


@quickly
@given(st.floats(0.0, 0.8), numbers(-3.0, 3.0), rotations())
def test_an_orbit_keeps_energy_momentum_and_its_plane(e: float, nu: float, R: np.ndarray) -> None:
    orbit, times = Orbit(EARTH, 9e6, e, nu, R), np.linspace(0.0, 2e4, 7)
    r, v = position_velocity(orbit, times)
    energy = 0.5 * np.sum(v * v, axis=1) - EARTH / np.linalg.norm(r, axis=1)
    np.testing.assert_allclose(energy, -EARTH / 1.8e7, rtol=1e-9)
    h = np.cross(r, v)
    np.testing.assert_allclose(h, np.broadcast_to(h[0], h.shape), rtol=1e-9, atol=1e-9 * np.linalg.norm(h[0]))
    axes = lvlh_axes(orbit, times)
    np.testing.assert_allclose(axes[..., 0], r / np.linalg.norm(r, axis=1)[:, None], atol=1e-9)
    np.testing.assert_allclose(axes[..., 2], h / np.linalg.norm(h, axis=1)[:, None], atol=1e-9)


@quickly
@given(arrays((6, 3)), turns(), arrays(3), st.floats(0.1, 10.0))
def test_points_moved_as_one_body_are_laid_onto_each_other(
    body: np.ndarray, q: np.ndarray, shift: np.ndarray, scale: float
) -> None:
    body = body + np.diag([1.0, 2.0, 3.0])[[0, 1, 2, 0, 1, 2]] * np.array([1, 1, 1, -1, -1, -1])[:, None] * 20
    seen = shift + rotate(q, body)
    turn, moved = horn(body, seen, np.ones(6))
    assert angle_between(turn, q) < 1e-6
    np.testing.assert_allclose(moved, shift, atol=1e-5)
    found = similarity(body, scale * seen)
    assert found is not None and np.isclose(found[0], scale)
    np.testing.assert_allclose(found[1], rotation_matrix(q), atol=1e-6)


@quickly
@given(arrays((4, 1, 2, 2), 1.0), arrays((4, 1, 2), 1.0), arrays((1, 2)))
def test_a_recurrence_is_linear_in_what_begins_it(step: np.ndarray, added: np.ndarray, first: np.ndarray) -> None:
    whole = recurrence(step, added, first)
    free = recurrence(step, np.zeros_like(added), first)
    driven = recurrence(step, added, np.zeros_like(first))
    np.testing.assert_allclose(whole, free + driven, atol=1e-9)
