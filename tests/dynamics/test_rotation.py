"""Quaternions and free rotation by their properties."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.dynamics import quaternion as quat
from massprops.dynamics.rigid_body import angular_acceleration, angular_momentum, kinetic_energy, propagate

RNG = np.random.default_rng(0)
Q = quat.normalise(RNG.standard_normal((50, 4)))
INERTIA = np.array([[2.0, 0.1, -0.2], [0.1, 2.6, 0.05], [-0.2, 0.05, 3.1]])


def test_rotation_matrix_and_back() -> None:
    R = quat.rotation_matrix(Q)
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3)) and np.allclose(np.linalg.det(R), 1)
    assert np.allclose(np.abs(np.sum(quat.from_rotation_matrix(R) * Q, axis=1)), 1)
    v = RNG.standard_normal((50, 3))
    assert np.allclose(quat.rotate(Q, v), np.einsum("nij,nj->ni", R, v))


def test_product_is_composition() -> None:
    R = quat.rotation_matrix
    assert np.allclose(R(quat.multiply(Q[:25], Q[25:])), R(Q[:25]) @ R(Q[25:]))
    assert np.allclose(quat.multiply(Q, quat.conjugate(Q)), [1, 0, 0, 0])


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 1.0, 3.1])
def test_rotation_vector_and_back(size: float) -> None:
    v = size * np.array([0.6, -0.64, 0.48])
    q = quat.from_rotation_vector(v)
    assert np.allclose(quat.rotation_vector(q), v, atol=1e-12)
    assert quat.angle_between(q, np.array([1.0, 0, 0, 0])) == pytest.approx(size, abs=1e-12)


def test_momentum_and_energy_are_constant() -> None:
    q, w = propagate(np.array([1.0, 0, 0, 0]), np.array([0.3, 1.0, -0.2]), INERTIA, np.linspace(0, 60, 61))
    h, e = angular_momentum(q, w, INERTIA), kinetic_energy(w, INERTIA)
    assert np.allclose(h, h[0], rtol=0, atol=1e-6 * np.linalg.norm(h[0]))
    assert np.allclose(e, e[0], rtol=1e-6)
    assert np.ptp(w[:, 1]) > 1.0, "about the middle axis the body turns over"


def test_step_error_is_of_fourth_order() -> None:
    times, start = np.array([0.0, 10.0]), (np.array([1.0, 0, 0, 0]), np.array([0.4, 0.5, -0.3]))
    exact = propagate(*start, INERTIA, times, largest_turn=0.01)[1][-1]
    coarse, fine = (np.abs(propagate(*start, INERTIA, times, largest_turn=s)[1][-1] - exact).max() for s in (0.4, 0.2))
    assert 10 < coarse / fine < 25


def test_rates_do_not_depend_on_the_body_frame() -> None:
    R = quat.rotation_matrix(Q[0])
    w = np.array([0.4, 0.5, -0.3])
    torque = np.array([0.01, -0.02, 0.03])
    own = angular_acceleration(w, INERTIA, torque)
    turned = angular_acceleration(R @ w, R @ INERTIA @ R.T, R @ torque)
    assert np.allclose(R @ own, turned)


def test_batch_equals_one_by_one() -> None:
    w0 = 0.3 * RNG.standard_normal((4, 3))
    times = np.linspace(0, 5, 6)
    together = propagate(Q[:4], w0, INERTIA, times, largest_turn=0.01)[1]
    alone = np.stack([propagate(Q[i], w0[i], INERTIA, times, largest_turn=0.01)[1] for i in range(4)], axis=1)
    assert np.allclose(together, alone, atol=1e-9)


@pytest.mark.parametrize("bodies", [(), (4,)])
def test_the_compiled_kernel_and_the_plain_propagation_agree(bodies: tuple[int, ...]) -> None:
    q, w0 = (Q[:4], 0.3 * RNG.standard_normal((4, 3))) if bodies else (Q[0], np.array([0.4, 0.5, -0.3]))
    plain, compiled = (propagate(q, w0, INERTIA, np.linspace(0, 5, 6), 0.1, compiled=c) for c in (False, True))
    assert compiled[0].shape == (6, *bodies, 4) and np.abs(plain[1][-1] - w0).max() > 0.01
    for one, other in zip(plain, compiled, strict=True):
        assert np.allclose(one, other, rtol=0, atol=1e-13)
