"""What holds of steps of the state, frames of the inertia and points in two cameras whatever the numbers are."""

from __future__ import annotations

import numpy as np
from drawn import arrays, inertias, quickly, rotations, turns
from hypothesis import assume, given
from hypothesis import strategies as st

from massprops.dynamics.inertia import is_physical, ratios
from massprops.dynamics.rigid_body import propagate
from massprops.estimators.judgement import memory_of
from massprops.estimators.momentum import plain_inertia
from massprops.estimators.unique_frame import sign_rule, unique_frame
from massprops.model.state import inertia_directions, inertia_of, log_shape, moved_inertia, second_moment
from massprops.sensing.pinhole import Pinhole, at_depth, project
from massprops.sensing.stereo import triangulate

LENS = np.array([900.0, 880.0, 320.0, 240.0])


@quickly
@given(inertias(), rotations())
def test_a_second_moment_comes_back_and_its_shape_has_no_size(I: np.ndarray, R: np.ndarray) -> None:
    np.testing.assert_allclose(inertia_of(second_moment(I)), 3.0 * I, atol=1e-12)
    np.testing.assert_allclose(log_shape(5.0 * I), log_shape(I), atol=1e-9)
    assert np.isclose(np.linalg.norm(log_shape(R @ I @ R.T)), np.linalg.norm(log_shape(I)))


@quickly
@given(inertias(), arrays(5, 20.0))
def test_a_step_of_any_size_leads_to_a_body_that_can_be(I: np.ndarray, d: np.ndarray) -> None:
    np.testing.assert_allclose(moved_inertia(3.0 * I, np.zeros(5)), 3.0 * I, atol=1e-9)
    moved = moved_inertia(3.0 * I, d)
    assert is_physical(np.linalg.eigvalsh(moved)) and np.isclose(np.trace(moved), 3.0)


@quickly
@given(inertias(0.1), arrays(5, 1.0))
def test_a_small_step_goes_along_its_directions(I: np.ndarray, d: np.ndarray) -> None:
    step = 1e-6 * d
    change = moved_inertia(3.0 * I, step) - 3.0 * I
    np.testing.assert_allclose(change, np.tensordot(step, inertia_directions(3.0 * I), 1), atol=1e-10)


@quickly
@given(inertias(), rotations())
def test_a_unique_frame_is_right_handed_and_turns_with_the_body(I: np.ndarray, R: np.ndarray) -> None:
    moments, axes = unique_frame(I)
    assert np.all(np.diff(moments) <= 0) and np.isclose(np.linalg.det(axes), 1.0)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, I, atol=1e-12)
    assume(np.diff(np.sort(moments)).min() > 1e-3)
    turned = unique_frame(R @ I @ R.T)[1]
    np.testing.assert_allclose(np.abs(np.sum(turned * (R @ axes), axis=0)), 1.0, atol=1e-6)
    np.testing.assert_array_equal(unique_frame(I, sign_rule(I))[1], axes)


@quickly
@given(inertias(0.1), arrays(3, 0.5), turns())
def test_momentum_that_is_conserved_gives_the_inertia(I: np.ndarray, w0: np.ndarray, q0: np.ndarray) -> None:
    times = np.linspace(0.0, 40.0, 60)
    q, w = propagate(q0, w0, I, times, largest_turn=0.02, compiled=True)
    aside = np.linalg.svd(w)[1]
    assume(aside[2] > 0.05 * aside[0] > 0.01 and np.diff(np.linalg.eigvalsh(I)).min() > 0.01)
    np.testing.assert_allclose(ratios(plain_inertia(q, w))[0], ratios(I)[0], atol=1e-3)


@quickly
@given(arrays((60, 2), 3.0), st.floats(0.1, 10.0))
def test_a_memory_is_an_epoch_at_least_and_has_no_unit(series: np.ndarray, factor: float) -> None:
    assert memory_of(series) >= 1.0
    assert np.isclose(memory_of(factor * series), memory_of(series), rtol=1e-6)
    assert np.isclose(memory_of(-series), memory_of(series), rtol=1e-6)


@quickly
@given(arrays((5, 3), 1.0), rotations())
def test_a_point_that_two_cameras_see_comes_back(X: np.ndarray, R: np.ndarray) -> None:
    tilt = np.array([[np.cos(0.1), 0, -np.sin(0.1)], [0, 1, 0], [np.sin(0.1), 0, np.cos(0.1)]])
    cameras = (Pinhole(LENS, np.eye(3), np.zeros(3)), Pinhole(LENS, tilt, np.array([1.0, 0.1, 0.0])))
    X = X @ R.T + [0.0, 0.0, 9.0]
    uv = np.stack([project(camera, X) for camera in cameras], axis=1)
    found, covariance = triangulate(cameras, uv, np.array([0.3, 0.3]))
    np.testing.assert_allclose(found, X, atol=1e-6)
    assert np.linalg.eigvalsh(covariance).min() > 0
    for camera, seen in zip(cameras, np.swapaxes(uv, 0, 1), strict=True):
        depth = ((X - camera.t) @ camera.R.T)[:, 2]
        np.testing.assert_allclose(at_depth(camera, seen, depth, 0.3, 0.1)[0], X, atol=1e-9)
