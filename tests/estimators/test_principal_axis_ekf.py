import numpy as np
import pytest
from tumbling import scene

from massprops.campaigns.papers import hu2024
from massprops.dynamics.quaternion import normalise, rotation_matrix
from massprops.estimators.methods import principal_axis_ekf
from massprops.estimators.principal.follow import followed
from massprops.estimators.principal.frame import paper_frame, sign_rule, unique_frame
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess


def test_unique_frame_is_one_right_handed_frame_however_the_eigenvectors_come():
    rng = np.random.default_rng(1)
    R = rotation_matrix(normalise(rng.standard_normal((200, 4))))
    inertia = R @ np.diag([0.2, 0.35, 0.45]) @ np.swapaxes(R, 1, 2)
    moments, axes = unique_frame(inertia)
    assert np.allclose(moments, [0.45, 0.35, 0.2])
    assert np.allclose(np.linalg.det(axes), 1.0)
    assert np.allclose(axes @ (moments[..., None] * np.swapaxes(axes, 1, 2)), inertia)
    rule = sign_rule(inertia)
    assert (np.take_along_axis(axes[..., 0], rule.x[:, None], 1) > 0.5).all()
    assert (np.take_along_axis(axes[..., 2], rule.z[:, None], 1) > 0.5).all()


def test_kept_rule_never_flips_under_noise_where_the_paper_rule_does():
    rng = np.random.default_rng(2)
    R = rotation_matrix(normalise(rng.standard_normal((500, 4))))
    inertia = R @ np.diag([0.2, 0.35, 0.45]) @ np.swapaxes(R, 1, 2)
    noise = 0.01 * rng.standard_normal(inertia.shape)
    noisy = inertia + noise + np.swapaxes(noise, 1, 2)
    rule = sign_rule(inertia)

    def kept(a, b):
        return np.einsum("nji,nji->n", a, b) > 2.0

    assert kept(unique_frame(inertia, rule)[1], unique_frame(noisy, rule)[1]).all()
    assert not kept(paper_frame(inertia)[1], paper_frame(noisy)[1]).all()


def test_transition_of_the_compiled_filter_is_the_derivative_of_its_motion():
    from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, rotation_vector
    from massprops.estimators.principal.predict_kernel import step

    rng = np.random.default_rng(3)
    q, w, k = normalise(rng.standard_normal(4)), np.array([0.1, -0.2, 0.15]), np.array([-0.3, -0.2])
    r, v = np.array([3.0, -4.0, 50.0]), np.array([0.01, 0.02, -0.01])
    l = np.array([7e6, 0.0, 1e5])

    def moved(d):
        x = [multiply(q, from_rotation_vector(d[:3])), w + d[3:6], k + d[6:8], r + d[11:14], v + d[14:17]]
        F = np.empty((17, 17))
        step(*x, 0.2, 3.986e14, l, l, F)
        return x, F

    base, F = moved(np.zeros(17))
    for j in [*range(8), *range(11, 17)]:
        d = np.zeros(17)
        d[j] = 1e-5
        up, down = moved(d)[0], moved(-d)[0]
        turn = rotation_vector(multiply(conjugate(base[0]), up[0])) - rotation_vector(
            multiply(conjugate(base[0]), down[0])
        )
        change = np.concatenate([turn, up[1] - down[1], up[2] - down[2], np.zeros(3), up[3] - down[3], up[4] - down[4]])
        assert np.allclose(change / 2e-5, F[:, j], atol=2e-6)


@pytest.mark.parametrize(
    "given", [{}, {"outliers": 0.02}, {"gap": (90, 120)}, {"stereo": False, "attitude": True}, {"attitude": True}]
)
def test_ratios_within_their_sigma(given):
    s = scene(0, **given)
    found = principal_axis_ekf.estimate(s.problem, Prior(), first_guess(s.problem, Prior()))
    assert found.converged and found.observable, found.reason
    error = np.array([found.k1, found.k2]) - s.k
    assert (np.abs(error) < 4 * found.sigma_k + 1e-5).all()
    assert (found.sigma_k < 0.02).all()
    assert 0.8 < found.innovation < 1.2
    if found.body_frame == "attitude0":
        angle = np.arccos(np.clip(np.abs(np.diag(found.principal_axes.T @ s.axes)), 0, 1))
        assert np.degrees(angle).max() < 1.0
    if given.get("outliers"):
        assert found.gated >= 40


def test_spin_about_a_principal_axis_is_not_observable():
    s = scene(1, spin=(0.0, 0.0, 0.1))
    found = principal_axis_ekf.estimate(s.problem, Prior(), first_guess(s.problem, Prior()))
    assert not (found.converged and found.observable)
    assert found.reason


def test_frame_case_does_not_depend_on_the_other_seeds_and_never_flips():
    c = {**hu2024.configuration("frame"), "levels_rad": [1e-6], "duration_s": 30.0, "occlusions_s": [[20.0, 25.0]]}
    both = hu2024.runs(c, [3, 4])
    alone = hu2024.runs(c, [4])
    assert both[1] == alone[0]
    assert all(row["1e-06 flips"] == 0 for row in both)


def test_the_24_symmetries_are_the_rotations_of_the_cube():
    assert np.allclose(np.linalg.det(hu2024.SYMMETRIES), 1.0)
    assert len(np.unique(hu2024.SYMMETRIES.reshape(24, 9), axis=0)) == 24


def test_the_filter_is_the_same_in_all_24_frames_up_to_their_names():
    s = scene(1)
    start = first_guess(s.problem, Prior())
    here = followed(s.problem, Prior(), start, 1e-6, 1e-6)
    for turn in hu2024.SYMMETRIES[[5, 14]]:
        there = followed(s.problem, Prior(), start, 1e-6, 1e-6, turn)
        assert np.allclose(there.run.w, here.run.w @ turn, atol=1e-9)
        assert np.allclose(there.run.f, here.run.f @ turn, atol=1e-7)
        assert np.allclose(np.trace(there.run.P[17:, 17:]), np.trace(here.run.P[17:, 17:]), rtol=1e-5)


@pytest.mark.bench
def test_unique_frame_survives_occlusions_and_a_filter_without_a_start_does_not():
    rows = hu2024.runs(hu2024.configuration("motion"), list(range(5)))
    for level in ("1e-06", "5e-06", "2e-05", "5e-05"):
        assert sum(row[f"{level} with left_frame"] for row in rows) == 0
        assert sum(row[f"{level} without left_frame"] for row in rows) == 0
        assert min(row[f"{level} without unique_deg end"] for row in rows) > 60.0
        assert sum(row[f"{level} unstarted left_frame"] for row in rows) >= 3
        assert max(row[f"{level} with attitude_deg hidden"] for row in rows) < 15.0
