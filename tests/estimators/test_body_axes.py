"""The filter with its inertia in any body axes: its motion, its independence of those axes, its form in principal axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_ukf import INERTIA, RIG, SIGMA, motion, stereo

from massprops.dynamics.inertia import cholesky_inertia, cholesky_parameters, principal_axes, ratios_of_moments
from massprops.dynamics.quaternion import (
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
from massprops.dynamics.rigid_body import angular_acceleration
from massprops.estimators.filters import Measurements, Noise, State, body_axes, filter_epochs
from massprops.estimators.filters.principal_axes import in_principal_axes
from massprops.estimators.filters.setup import setup
from massprops.estimators.filters.state import EXTENDED
from massprops.estimators.filters.verdict import overconfident
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess
from massprops.sensing.pinhole import at_depth, project

TURN = from_rotation_vector(np.array([0.7, -0.4, 0.9]))


def test_its_motion_is_eulers() -> None:
    R = rotation_matrix(TURN)
    tensor, w = R @ INERTIA @ R.T / np.trace(INERTIA), np.array([0.3, -0.2, 0.5])
    numbers = cholesky_parameters(tensor)
    np.testing.assert_allclose(cholesky_inertia(numbers), tensor, atol=1e-12)
    np.testing.assert_allclose(
        body_axes.acceleration(body_axes.inertia_of(*numbers), *w), angular_acceleration(w, tensor), atol=1e-14
    )


def turned(state: State, turn: np.ndarray) -> State:
    """The same beginning in body axes from which `turn` leads to the present ones."""
    R = rotation_matrix(turn)

    def numbers(k: np.ndarray) -> np.ndarray:
        return cholesky_parameters(R @ cholesky_inertia(k) @ R.T)

    T = np.eye(len(state.P))
    T[:3, :3] = T[3:6, 3:6] = R
    T[6:11, 6:11] = np.stack([(numbers(state.k + d) - numbers(state.k - d)) / 2e-6 for d in 1e-6 * np.eye(5)], -1)
    for i in range(17, len(T), 3):
        T[i : i + 3, i : i + 3] = R
    return replace(
        state,
        w=R @ state.w,
        q=multiply(state.q, conjugate(turn)),
        k=numbers(state.k),
        features=state.features @ R.T,
        P=T @ state.P @ T.T,
    )


def test_another_choice_of_body_axes_gives_the_same_motion() -> None:
    """But for the second order of the errors, in which the five numbers of an inertia depend on its axes."""
    small = 0.1
    rng = np.random.default_rng(0)
    t, q, w = motion(25)
    p = rng.uniform(-1, 1, (4, 3))
    r = np.array([0.2, 0.1, 8.0])
    uv = np.stack([project(c, r + rotate(q[:, None], p[None])) for c in RIG], axis=2)
    z = (uv + small * SIGMA * rng.normal(size=uv.shape)).reshape(len(t), -1)
    seen = Measurements(np.diff(t, prepend=t[0]), z, np.full(z.shape, (small * SIGMA) ** 2), RIG)
    sigma = small * np.repeat([0.001, 0.003, 0.005, 0.02, 0.005, 0.01], [3, 3, 5, 3, 3, 12])
    k = cholesky_parameters(INERTIA / np.trace(INERTIA))
    state = State(w[0] * 1.0002, q[0], k + 0.002 * small, p + 0.01 * small, np.diag(sigma**2), position=r, moving=True)
    noise = Noise(w=1e-12, attitude=1e-12, k=0.0, velocity=1e-10)
    here = filter_epochs(state, seen, noise, EXTENDED)
    there = filter_epochs(turned(state, TURN), seen, noise, EXTENDED)
    R = rotation_matrix(TURN)
    assert np.abs(here.w[-1] - w[-1]).max() < 1e-4
    np.testing.assert_allclose(there.w, here.w @ R.T, atol=1e-7)
    np.testing.assert_allclose(cholesky_inertia(there.k), R @ cholesky_inertia(here.k) @ R.T, atol=1e-6)
    np.testing.assert_allclose(there.nis, here.nis, rtol=1e-3)


def test_in_principal_axes_an_error_is_what_the_change_of_axes_makes_of_it() -> None:
    problem = stereo(n=120)
    ready = setup(problem, Prior(), first_guess(problem))
    body = ready.state
    e = 1e-6 * np.random.default_rng(1).normal(size=len(body.P))
    got = in_principal_axes(replace(ready, state=replace(body, P=np.outer(e, e)))).state

    def principal(error: np.ndarray) -> tuple[np.ndarray, ...]:
        moments, axes = principal_axes(cholesky_inertia(body.k + error[6:11]))
        if np.trace(axes.T @ rotation_matrix(multiply(conjugate(body.q), got.q))) < 2:
            axes = axes @ np.diag(np.sign(np.diag(axes.T @ rotation_matrix(multiply(conjugate(body.q), got.q)))))
        turn = multiply(body.q, from_rotation_vector(error[3:6]))
        features = body.features + error[17:].reshape(-1, 3)
        return (
            (body.w + error[:3]) @ axes,
            multiply(turn, from_rotation_matrix(axes)),
            ratios_of_moments(moments),
            features @ axes,
        )

    before, after = principal(np.zeros(len(e))), principal(e)
    moved = np.concatenate(
        [
            after[0] - before[0],
            rotation_vector(multiply(conjugate(before[1]), after[1])),
            after[2] - before[2],
            e[11:17],
            (after[3] - before[3]).ravel(),
        ]
    )
    np.testing.assert_allclose(got.P, np.outer(moved, moved), atol=2e-3 * np.max(moved**2))
    np.testing.assert_allclose(got.w, before[0], atol=1e-12)


def test_sigmas_that_no_measurement_earned_are_said() -> None:
    shown = np.array([0.08, 0.06])
    assert "hardly shows" in overconfident(np.array([0.03, 0.05]), shown, 0.3)
    assert not overconfident(np.array([0.07, 0.05]), shown, 0.3)
    assert not overconfident(np.array([0.01, 0.01]), shown, 0.01), "the prior knew it"


def test_a_point_at_a_believed_depth() -> None:
    pixel = np.array([[350.0, 260.0], [100.0, 400.0]])
    for camera in RIG:
        X, covariance = at_depth(camera, pixel, np.array([5.0, 9.0]), 0.3, 2.0)
        np.testing.assert_allclose(project(camera, X), pixel, atol=1e-9)
        ray = X - camera.t
        for point, spread in zip(ray, covariance, strict=True):
            across = np.cross(point, [0.0, 1.0, 0.0])
            across /= np.linalg.norm(across)
            assert np.sqrt(across @ spread @ across) < 0.01
            assert np.sqrt(point @ spread @ point) / np.linalg.norm(point) > 1.9


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_means_of_turns(sign: float) -> None:
    noise = from_rotation_vector(0.01 * np.random.default_rng(2).normal(size=(400, 3)))
    q = sign * multiply(TURN, noise)
    q[::3] *= -1.0
    for mean in (rotation_matrix(mean_quaternion(q)), nearest_rotation(rotation_matrix(q).sum(axis=0))):
        assert np.linalg.norm(rotation_vector(from_rotation_matrix(rotation_matrix(TURN).T @ mean))) < 3e-3
    flipped = np.diag([1.0, 1.0, -1.0])
    assert np.linalg.det(nearest_rotation(np.stack([flipped, np.eye(3)]))) == pytest.approx([1.0, 1.0])
