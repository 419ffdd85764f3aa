"""The chaser's Kepler motion, by its own laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from massprops.campaigns.papers._pesce2017_run import _camera_frame
from massprops.dynamics.chaser_path import chaser_path, transitions
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.kernels import differential_gravity
from massprops.dynamics.orbit import (
    eccentric_anomaly,
    lvlh_axes,
    lvlh_rate,
    position_velocity,
    true_anomaly,
)
from massprops.sequence.data import Environment, Orbit

MU = 3.986004418e14
PERIFOCAL = Rotation.from_euler("ZXZ", [1.1, 0.3, 5.9]).as_matrix()


def orbit(e: float, nu: float = 0.7) -> Orbit:
    return Orbit(MU, 7.17e6, e, nu, PERIFOCAL)


@pytest.mark.parametrize("e", [0.0, 0.05, 0.5, 0.95])
def test_kepler_equation_is_solved(e: float) -> None:
    M = np.linspace(-20, 20, 401)
    E = eccentric_anomaly(M, e)
    assert np.abs(E - e * np.sin(E) - M).max() < 1e-12


@pytest.mark.parametrize("e", [0.0, 0.05, 0.6])
def test_energy_and_momentum_are_kept_and_velocity_is_the_derivative(e: float) -> None:
    o, t = orbit(e), np.linspace(0, 9000, 60)
    r, v = position_velocity(o, t)
    assert true_anomaly(o, np.zeros(1))[0] == pytest.approx(0.7)
    energy = 0.5 * np.sum(v * v, -1) - MU / np.linalg.norm(r, axis=-1)
    assert np.ptp(energy) < 1e-9 * abs(energy[0])
    h = np.cross(r, v)
    assert np.abs(h - h[0]).max() < 1e-9 * np.linalg.norm(h[0])
    numeric = (position_velocity(o, t + 0.01)[0] - position_velocity(o, t - 0.01)[0]) / 0.02
    assert np.abs(numeric - v).max() < 1e-4
    acceleration = (position_velocity(o, t + 0.1)[1] - position_velocity(o, t - 0.1)[1]) / 0.2
    pull = -MU * r / np.linalg.norm(r, axis=-1, keepdims=True) ** 3
    assert np.abs(acceleration - pull).max() < 1e-5


def test_lvlh_axes_turn_at_the_stated_rate() -> None:
    o, t = orbit(0.3), np.linspace(0, 6000, 25)
    L = lvlh_axes(o, t)
    r, v = position_velocity(o, t)
    np.testing.assert_allclose(L[..., 0], r / np.linalg.norm(r, axis=-1, keepdims=True), atol=1e-12)
    assert (np.einsum("ni,ni->n", L[..., 1], v) > 0).all()
    assert np.abs(np.linalg.det(L) - 1).max() < 1e-12
    rate, acceleration = lvlh_rate(o, t)
    turning = (lvlh_axes(o, t + 0.05) - lvlh_axes(o, t - 0.05)) / 0.1
    np.testing.assert_allclose(turning, np.cross(rate[:, None], np.swapaxes(L, 1, 2)).swapaxes(1, 2), atol=1e-9)
    np.testing.assert_allclose(
        (lvlh_rate(o, t + 1)[0] - lvlh_rate(o, t - 1)[0]) / 2, acceleration, rtol=1e-3, atol=1e-12
    )


def test_a_neighbour_on_its_own_kepler_orbit_moves_as_differential_gravity_says() -> None:
    leader, other = orbit(0.05), Orbit(MU, 7.17e6 + 60, 0.05, 0.7, PERIFOCAL)
    t = 500.0
    r, _ = position_velocity(leader, np.asarray(t))
    rho = [
        position_velocity(other, np.asarray(t + d))[0] - position_velocity(leader, np.asarray(t + d))[0]
        for d in (-5, 0, 5)
    ]
    second = (rho[0] - 2 * rho[1] + rho[2]) / 25
    pull = np.array(differential_gravity(MU, *r, *rho[1]))
    np.testing.assert_allclose(second, pull, atol=2e-8)
    assert np.linalg.norm(pull) > 1e-5


def test_steps_beside_the_chaser_follow_a_neighbour_on_its_own_orbit() -> None:
    environment = orbit(0.05)
    other = Orbit(MU, 7.17e6 + 5, 0.05, 0.7, PERIFOCAL)
    times = 10.0 * np.arange(31)
    path = chaser_path(Environment("inertial", environment), times)
    one, two = position_velocity(environment, times), position_velocity(other, times)
    x = np.concatenate([two[0][0] - one[0][0], two[1][0] - one[1][0]])
    for F in transitions(path, times):
        x = F @ x
    assert np.linalg.norm(x[:3] - (two[0][-1] - one[0][-1])) < 1e-3 < 0.1 < np.linalg.norm(x[:3])
    np.testing.assert_allclose(path.rate, 0.0)


def test_camera_frame_is_the_one_that_the_simulator_uses() -> None:
    environment = Environment("lvlh", orbit(0.2))
    theirs = EnvironmentModel(environment)
    for t in (0.0, 40.0, 3000.0):
        np.testing.assert_allclose(
            _camera_frame(environment.orbit, t)[0].T, theirs.chaser_turn(np.array([t]))[0], atol=1e-11
        )
        there = position_velocity(orbit(0.2), np.asarray(t))[0]
        np.testing.assert_allclose(there, np.array(theirs.position(t)), rtol=1e-12)


def test_the_field_of_a_dipole_along_the_orbit() -> None:
    """Twice as strong over its poles as over its equator, and the other way there; it falls by the cube."""
    o, dipole = Orbit(MU, 7.17e6, 0.3, 0.0, PERIFOCAL), 8e15
    times = np.linspace(0.0, 6000.0, 7)

    def field(along: np.ndarray) -> np.ndarray:
        model = EnvironmentModel(Environment(orbit=o, magnetic_dipole_T_m3=dipole * along))
        assert "magnetic field" in model.known
        return np.stack(model.state(times, orbiting=False).field, axis=1)

    r = np.stack(EnvironmentModel(Environment(orbit=o)).position(times), axis=1)
    cube = np.linalg.norm(r, axis=1) ** 3
    assert field(PERIFOCAL[:, 2]) == pytest.approx(-dipole / cube[:, None] * PERIFOCAL[:, 2])
    assert field(r[0] / np.linalg.norm(r[0]))[0] == pytest.approx(2.0 * dipole * r[0] / np.linalg.norm(r[0]) ** 4)
    model = EnvironmentModel(Environment(orbit=o, magnetic_dipole_T_m3=dipole * PERIFOCAL[:, 0]))
    known = model.known_in_body(times, np.broadcast_to(np.eye(3), (7, 3, 3)))["field"]
    own = field(PERIFOCAL[:, 0])
    assert known == pytest.approx(own / np.linalg.norm(own, axis=1, keepdims=True))
