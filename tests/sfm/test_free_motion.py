"""Models of one free body, each in a frame and a size of its own, are laid to each other by the motion alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from massprops.dynamics.rigid_body import propagate
from massprops.sfm.free_motion import FreeRotation, Piece, fit_centres, fit_rotation

INERTIA = np.diag([0.4, 0.9, 1.0])


def tumbling(n=54, rate_deg=7.0, spin=(0.3, 1.0, -0.25)):
    """(n, 3, 3) attitudes, body to camera, of a free body about its middle axis."""
    w0 = np.deg2rad(rate_deg) * np.array(spin) / np.linalg.norm(spin)
    q, _ = propagate(np.array([0.5, 0.5, -0.1, 0.7]) / np.sqrt(1.0), w0, INERTIA, np.arange(n, dtype=float))
    return Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()


def pieces(R, which, noise_deg=0.0, depth_noise=0.0, seed=0):
    """Pieces of footage, the turn to the first one's axes, and scale and shift to its frame, of a body that drifts."""
    rng = np.random.default_rng(seed)
    position = np.array([0.1, -0.2, 12.0]) + np.arange(len(R))[:, None] * np.array([0.004, -0.002, 0.03])
    out, truth = [], []
    for index in which:
        index = np.asarray(index)
        A, s, h = Rotation.random(random_state=rng).as_matrix(), rng.uniform(0.3, 3), 0.3 * rng.standard_normal(3)
        # x = s A y + h takes a point y of the piece to the body's axes, about its centre of mass
        wrong = Rotation.from_rotvec(np.deg2rad(noise_deg) * rng.standard_normal((len(index), 3))).as_matrix()
        own, t = wrong @ R[index] @ A, (R[index] @ h + position[index]) / s
        t[:, 2] *= 1 + depth_noise * rng.standard_normal(len(index))
        out.append(Piece(index.astype(float), own, t))
        truth.append((A, s, h))
    A0, s0, h0 = truth[0]
    C = np.array([A0.T @ A for A, _, _ in truth])
    scale = np.array([s / s0 for _, s, _ in truth])
    shift = np.array([A0.T @ (h - h0) / s0 for _, _, h in truth])
    return out, C, scale, shift


def off_deg(C, D):
    return np.rad2deg(Rotation.from_matrix(C.transpose(0, 2, 1) @ D).magnitude())


def test_pieces_across_an_eclipse_turn_to_each_other_as_the_motion_says():
    """Nine images in Sun, nine in shadow: 70 degrees between the pieces."""
    own, C, scale, shift = pieces(tumbling(), [range(9), range(18, 27), range(36, 45)], 0.05, 3e-4)
    found = fit_rotation(own)
    assert found.rms < np.deg2rad(0.1)
    assert off_deg(C, found.C).max() < 0.5
    assert np.all(off_deg(C, found.C)[1:] < 6 * np.rad2deg(found.sigma[1:]))
    centres = fit_centres(own, found, 0.1)
    np.testing.assert_allclose(centres.scale, scale, rtol=0.01)
    assert np.abs(centres.shift - shift).max() < 0.1 / min(1.0, float(scale.min()))


def test_without_noise_both_are_exact():
    own, C, scale, shift = pieces(tumbling(), [range(18, 27), range(9), range(30, 36)])
    found = fit_rotation(own)
    assert off_deg(C, found.C).max() < 1e-3
    centres = fit_centres(own, found, 0.1)
    np.testing.assert_allclose(centres.scale, scale, rtol=1e-5)
    np.testing.assert_allclose(centres.shift, shift, atol=1e-4)


@pytest.mark.parametrize("seed", range(2))
def test_what_is_no_free_motion_is_far_off(seed):
    """The second piece turns as fast about an axis across."""
    R = tumbling()
    axis = np.cross([0.3, 1.0, -0.25], [1.0, 0, 0]) if seed else np.array([1.0, 0.0, 0.0])
    across = Rotation.from_rotvec(np.deg2rad(7) * np.arange(54)[:, None] * axis / np.linalg.norm(axis)).as_matrix()
    R[18:] = across[18:]
    own, *_ = pieces(R, [range(9), range(18, 27)])
    assert fit_rotation(own).rms > np.deg2rad(1.0)


def test_across_a_wide_gap_the_longest_piece_tells_the_motion():
    """The body turns by 280 degrees while nothing is seen, and its rates do not go straight across."""
    own, C, _, _ = pieces(tumbling(110), [range(50, 100), range(0, 10)], 0.1)
    straight, alone = fit_rotation(own), fit_rotation(own[:1])
    found = fit_rotation(own, robust=True, about=alone.motion)
    assert found.rms < np.deg2rad(0.15) < straight.rms
    assert off_deg(C, found.C).max() < 1


def test_one_attitude_in_ten_astray_moves_a_robust_fit_little():
    own, _, _, _ = pieces(tumbling(), [range(54)], 0.1)
    R = own[0].R.copy()
    R[::10] = Rotation.from_rotvec([0, 0, 0.1]).as_matrix() @ R[::10]
    astray = [Piece(own[0].times, R, own[0].t)]
    right = fit_rotation(own).motion.attitudes(own[0].times)[0]
    off = [
        off_deg(right, fit_rotation(astray, robust=robust).motion.attitudes(own[0].times)[0]).max()
        for robust in (False, True)
    ]
    assert off[1] < 0.3 < 1 < off[0]


def test_a_motion_that_no_step_can_follow_is_no_number_and_no_error():
    """Far from all bodies' inertias the integration fails; a fit that asks for one there steps back."""
    rng = np.random.default_rng(0)
    motions = FreeRotation(np.eye(3), rng.normal(0, 0.6, 3), np.zeros(5), 0.0, 1.0)
    wild = np.zeros((2, 11))
    wild[1, 6:] = rng.uniform(-5, 5, 5)
    R = motions.attitudes(np.arange(60.0), wild)
    assert np.isfinite(R[0]).all()
    assert not np.isfinite(R[1, -1]).any()


@given(st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_pieces_of_nonsense_are_fitted_without_an_error(seed):
    rng = np.random.default_rng(seed)
    own, begin = [], 0
    for _ in range(rng.integers(1, 4)):
        n = int(rng.integers(3, 12))
        turns = Rotation.random(n, random_state=rng).as_matrix()
        own.append(Piece(begin + np.arange(n, dtype=float), turns, rng.standard_normal((n, 3))))
        begin += n + int(rng.integers(1, 20))
    assert np.isfinite(fit_rotation(own, robust=True).rms)
