from dataclasses import replace

import numpy as np
import pytest
from tumbling import scene

from massprops.campaigns.papers import volpe2017
from massprops.dynamics.inertia import cholesky_inertia as inertia
from massprops.dynamics.inertia import cholesky_parameters as from_inertia
from massprops.dynamics.inertia import cholesky_ratio_derivatives, principal_axes, ratios
from massprops.dynamics.quaternion import conjugate, rotate
from massprops.dynamics.rigid_body import propagate
from massprops.errors import NotPossible
from massprops.estimators.filters import gravity
from massprops.estimators.filters.body_axes import six_elements
from massprops.estimators.methods import range_ukf
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess


def body():
    rng = np.random.default_rng(5)
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return R @ np.diag([0.24, 0.33, 0.43]) @ R.T


def test_kernel_inertia_is_that_of_the_general_parameters():
    s = from_inertia(body())
    xx, yy, zz, xy, xz, yz = six_elements(*s)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert np.allclose(tensor / np.trace(tensor), inertia(s), atol=1e-14)


def test_kernel_motion_is_the_physics_of_the_simulator():
    tensor = body()
    q, w = np.array([0.5, 0.5, -0.5, 0.5]), np.array([0.02, -0.03, 0.01])
    y = np.concatenate([q, w, [1.0, 2.0, 30.0], [0.01, 0.0, -0.02]])
    gravity.move_under_gravity(y, from_inertia(tensor), 10.0, 20, np.zeros(10))
    expected_q, expected_w = propagate(q, w, tensor, np.array([0.0, 10.0]), largest_turn=0.01)
    assert np.allclose(y[:4], expected_q[-1], atol=1e-9)
    assert np.allclose(y[4:7], expected_w[-1], atol=1e-11)
    assert np.allclose(y[7:10], [1.1, 2.0, 29.8])


def test_kernel_gravity_is_that_of_the_effect_and_of_the_kernels():
    from massprops.dynamics.effects import gravity_gradient_torque
    from massprops.dynamics.environment import EnvironmentState
    from massprops.dynamics.kernels import differential_gravity, euler_acceleration

    rng = np.random.default_rng(7)
    y = np.concatenate(
        [np.array([0.5, 0.5, -0.5, 0.5]), rng.standard_normal(3), [1.0, 2.0, 30.0], rng.standard_normal(3)]
    )
    l, mu, out = np.array([7e6, -1e5, 3e4]), 3.986e14, np.empty(13)
    six = six_elements(*from_inertia(body()))
    gravity.slope_under_gravity(y, six, l, mu, out)
    torque = gravity_gradient_torque.torque(
        0.0, tuple(y[:4]), None, (1.0,), six, EnvironmentState(tuple(l + y[7:10]), (), (), mu)
    )
    assert np.allclose(out[4:7], euler_acceleration(six, tuple(y[4:7]), torque), rtol=1e-12)
    assert np.allclose(out[10:], differential_gravity(mu, *l, *y[7:10]), rtol=1e-12)


def test_ratio_derivatives():
    s = from_inertia(body())
    by_k, by_turn = cholesky_ratio_derivatives(s)
    axes = principal_axes(inertia(s))[1]
    for a in range(5):
        e = np.zeros(5)
        e[a] = 1e-5
        up, down = inertia(s + e), inertia(s - e)
        assert np.allclose((ratios(up)[0] - ratios(down)[0]) / 2e-5, by_k[:, a], atol=1e-6)
        turn = (axes.T @ (principal_axes(up)[1] - principal_axes(down)[1]) / 2e-5)[[2, 0, 1], [1, 2, 0]]
        assert np.allclose(turn, by_turn[:, a], atol=1e-5)


@pytest.mark.parametrize("given", [{}, {"outliers": 0.01}])
def test_ratios_and_metric_position_from_one_camera(given):
    s = scene(1, stereo=False, attitude=True, range_sigma=0.02, **given)
    found = range_ukf.estimate(s.problem, Prior(), first_guess(s.problem))
    assert found.converged and found.observable, found.reason
    error = np.array([found.k1, found.k2]) - s.k
    assert (np.abs(error) < 4.5 * found.sigma_k).all()
    assert (found.sigma_k < 0.02).all()
    assert np.linalg.norm(found.position[-1] - s.r[-1]) < 0.02
    assert len(found.q) == len(found.times) == len(found.k_history)


def test_without_attitude_it_says_what_to_do():
    s = scene(1, n=40, stereo=False, range_sigma=0.02)
    with pytest.raises(NotPossible, match="attitude0"):
        range_ukf.estimate(s.problem, Prior(), None)


def test_flat_spin_is_not_observable():
    s = scene(0, stereo=False, attitude=True, range_sigma=0.02, spin=(0.0, 0.1, 0.0))
    found = range_ukf.estimate(s.problem, Prior(), first_guess(s.problem))
    assert not (found.converged and found.observable)


def quick_orbit():
    """The paper's orbit with an image each 5 s: a fifth of the work, and sigmas that bend five times as much."""
    windows = [4, 7, 12, 20, 35, 60, 100, 150, 200]
    return {**volpe2017.configuration("orbit"), "step_s": 5.0, "batch_windows": windows, "turn_noise_rad2_s3": 2e-18}


def test_one_orbit_as_the_paper_asks():
    rows = volpe2017.runs(quick_orbit(), [0, 1])

    def gain(name):
        return np.sqrt(
            np.mean([r[f"{name} start"] ** 2 for r in rows]) / np.mean([r[f"{name} end"] ** 2 for r in rows])
        )

    assert gain("position") > 100
    assert gain("velocity") > 1000
    assert gain("rate") > 1000
    assert gain("k1") > 5 and gain("k2") > 5
    # all of the motion and inertia together: what is known sharply of their combinations must be true, too
    assert max(r["nees all of them"] for r in rows) < 40.8  # 1 of 1000 of chi-squared with 17 degrees of freedom
    assert volpe2017.runs(quick_orbit(), [1])[0] == rows[1]


def test_the_batch_finds_its_way_out_of_the_mirror(monkeypatch):
    c = {**quick_orbit(), "start_sigma_rate_deg_s": 1.0, "start_sigma_position_m": 1.0}
    truth = volpe2017._truth(c)
    plain = volpe2017._start

    def reversed_across_the_sight(*given):
        start = plain(*given)
        sight = rotate(conjugate(start.q), start.r) / np.linalg.norm(start.r)
        w = 2 * (truth["w"][0] @ sight) * sight - truth["w"][0]
        return replace(start, w=w)

    monkeypatch.setattr(volpe2017, "_start", reversed_across_the_sight)
    monkeypatch.setattr(volpe2017, "range_filtered", lambda begin, *_, **__: begin)
    monkeypatch.setattr(volpe2017, "_scores", lambda c, truth, points, start, run: {"start": start, "end": run})
    fit = volpe2017._run(c, truth, 7)
    end = c["batch_windows"][-1] - 1
    assert np.degrees(np.linalg.norm(fit["start"].w - truth["w"][0])) > 1.5
    assert np.degrees(np.linalg.norm(fit["end"].w - truth["w"][end])) < 0.02
