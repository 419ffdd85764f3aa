"""The first guess against truth, from each kind of measurement, with features that come and go and outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tumbling import Scene
from tumbling import far_scene as scene

from massprops.dynamics.alignment import align, horn, q_method
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import (
    angle_between,
    conjugate,
    from_rotation_vector,
    multiply,
    normalise,
    rotate,
    rotation_matrix,
)
from massprops.errors import NotPossible
from massprops.estimators.start import Start, first_guess
from massprops.sensing.pinhole import Pinhole, project
from massprops.sensing.stereo import triangulate


def checked(start: Start, made: Scene, attitude: float, rate: float, place: float | None, k: float) -> None:
    """Largest errors: attitude [rad], rate (relative), place [m] of path and features, k of the ratios."""
    at = start.index
    assert at is not None
    turn = multiply(conjugate(start.q[:1]), made.q[at[:1]]) if start.body_frame == "own" else np.array([[1.0, 0, 0, 0]])
    D = rotation_matrix(turn)[0]
    assert angle_between(multiply(start.q, turn), made.q[at]).max() < attitude
    miss = np.linalg.norm(start.w @ D - made.w[at], axis=1) / np.linalg.norm(made.w[at], axis=1)
    assert np.median(miss) < rate
    if place is not None:
        assert start.position is not None and start.features is not None
        assert np.linalg.norm(start.position - made.r[at], axis=1).max() < place
        assert np.nanmax(np.linalg.norm(start.features @ D - made.features, axis=1)) < place
    assert start.inertia is not None
    assert np.abs(ratios(start.inertia)[0] - ratios(made.inertia)[0]).max() < k


def test_triangulation_of_two_turned_cameras_with_honest_covariance():
    rng = np.random.default_rng(3)
    turn = rotation_matrix(from_rotation_vector(np.array([0.05, -0.2, 0.1])))
    cameras = (
        Pinhole(np.array([900.0, 950.0, 320.0, 240.0]), np.eye(3), np.zeros(3)),
        Pinhole(np.array([800.0, 820.0, 300.0, 250.0]), turn, np.array([1.0, 0.2, -0.1])),
    )
    X = np.array([0.3, -0.4, 8.0])
    uv = np.stack([project(camera, np.tile(X, (4000, 1))) for camera in cameras], axis=1)
    exact, _ = triangulate(cameras, uv[:1], np.array([0.4, 0.7]))
    np.testing.assert_allclose(exact[0], X, atol=1e-9)
    uv += rng.normal(size=uv.shape) * np.array([0.4, 0.7])[:, None]
    points, covariance = triangulate(cameras, uv, np.array([0.4, 0.7]))
    error = points - X
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert abs(square.mean() / 3.0 - 1.0) < 0.06


def test_points_that_stereo_cannot_place_are_nan():
    lens = np.array([1000.0, 1000.0, 0, 0])
    cameras = (Pinhole(lens, np.eye(3), np.zeros(3)), Pinhole(lens, np.eye(3), np.array([0.1, 0, 0])))
    uv = np.array(
        [
            [[0.0, 0.0], [-10.0, 0.0]],  # 10 m away
            [[0.0, 0.0], [-0.5, 0.0]],  # disparity within its noise
            [[0.0, 0.0], [10.0, 0.0]],  # behind
            [[0.0, 0.0], [-10.0, 40.0]],  # the rays miss each other
            [[np.nan, np.nan], [-10.0, 0.0]],
        ]
    )
    points, covariance = triangulate(cameras, uv, np.array([0.5, 0.5]))
    assert np.isfinite(points).all(axis=1).tolist() == [True, False, False, False, False]
    assert np.isfinite(covariance).all(axis=(1, 2)).tolist() == [True, False, False, False, False]


def test_q_method_gives_hamilton_quaternions_of_any_rotation():
    rng = np.random.default_rng(0)
    q = normalise(rng.normal(size=(200, 4)))
    body = rng.normal(size=(200, 4, 3))
    found = q_method(body, rotate(q[:, None], body), np.ones((200, 4)))
    assert angle_between(found, q).max() < 1e-6
    found, shift = horn(body, rotate(q[:, None], body) + np.array([1.0, 2, 3]), np.ones((200, 4)))
    assert angle_between(found, q).max() < 1e-6
    np.testing.assert_allclose(shift, np.tile([1.0, 2, 3], (200, 1)), atol=1e-9)


def test_weighted_alignment_has_the_covariance_it_states_and_leaves_outliers_out():
    rng = np.random.default_rng(1)
    body = rng.uniform(-1, 1, (8, 3))
    q = normalise(rng.normal(size=(500, 4)))
    sigma = np.array([0.001, 0.001, 0.05])
    seen = rotate(q[:, None], body[None]) + rng.normal(size=(500, 8, 3)) * sigma
    seen[:, 0] += 1.0
    information = np.broadcast_to(np.diag(sigma**-2.0), (500, 8, 3, 3))
    guess = multiply(from_rotation_vector(rng.normal(0, 0.05, (500, 3))), q)
    got, _, covariance, near = align(body, seen, information, np.ones((500, 8), bool), guess, np.zeros((500, 3)))
    assert (near[:, 0] > 100).mean() > 0.99
    from massprops.dynamics.quaternion import rotation_vector

    error = rotation_vector(multiply(got, conjugate(q)))
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance[:, :3, :3]), error)
    assert 0.85 < np.median(square) / 2.366 < 1.2


def test_stereo_alone():
    made = scene(epochs=300)
    start = first_guess(made.problem)
    assert start.body_frame == "own" and start.scaled
    checked(start, made, 2e-3, 2e-3, 0.01, 2e-3)
    np.testing.assert_allclose(start.velocity, made.velocity, atol=1e-4)


def test_stereo_with_features_that_come_and_go():
    made = scene(epochs=300, features=60, seen_for=60)
    start = first_guess(made.problem)
    assert len(start.times) > 290
    checked(start, made, 5e-3, 5e-3, 0.03, 5e-3)


def test_stereo_with_gaps_and_outliers():
    made = scene(epochs=300, features=12, missing=0.2, outliers=0.05, seed=4)
    hidden = np.arange(100, 130)
    made.problem.uv[hidden] = np.nan
    start = first_guess(made.problem)
    assert not np.isin(start.index, hidden).any()
    assert np.isfinite(start.q).all() and np.isfinite(start.w).all()
    checked(start, made, 2e-3, 2e-3, 0.01, 2e-3)


def test_only_what_was_seen_by_then():
    made = scene(epochs=300)
    start = first_guess(made.problem, until_s=150.0)
    assert start.times[-1] == 150.0
    changed = replace(made.problem, uv=np.where(made.problem.times[:, None, None, None] > 150, 0.0, made.problem.uv))
    again = first_guess(changed, until_s=150.0)
    np.testing.assert_array_equal(again.w, start.w)


def test_a_stretch_apart_from_the_rest_is_left_out_with_a_warning():
    made = scene(epochs=200, features=10)
    made.problem.uv[:120, :, 5:] = np.nan
    made.problem.uv[120:, :, :5] = np.nan
    start = first_guess(made.problem)
    assert start.index is not None and start.index.max() < 120
    assert any("80 epochs" in line for line in start.warnings)


def with_attitude(made: Scene, sigma: float, seed: int = 0) -> Scene:
    rng = np.random.default_rng(seed)
    n = len(made.q)
    q = multiply(from_rotation_vector(rng.normal(0, sigma, (n, 3))), made.q)
    return replace(made, problem=replace(made.problem, attitude=q, sigma_attitude=np.full(n, sigma)))


def test_one_camera_with_attitude_places_features_up_to_scale():
    near = {"cameras": 1, "focal": 1000.0, "position": (0.3, 0.2, 10.0), "velocity": (-0.001, 0.002, 0.003)}
    made = with_attitude(scene(epochs=150, features=60, step=1.5, sigma_px=0.3, seen_for=60, **near), 1e-3)
    start = first_guess(made.problem)
    assert start.body_frame == "attitude0" and not start.scaled
    assert start.position is not None and start.features is not None and start.velocity is not None
    assert any("shows no lengths" in line for line in start.warnings)
    size = made.r[0, 2] / start.position[0, 2]
    known = replace(start, position=start.position * size, features=start.features * size)
    checked(known, made, 3e-3, 5e-3, 0.03, 0.02)


def test_range_gives_the_scale():
    near = {"cameras": 1, "focal": 1000.0, "position": (0.3, 0.2, 10.0), "velocity": (0.0, 0.0, 0.0)}
    made = with_attitude(scene(epochs=150, features=40, step=1.5, sigma_px=0.3, **near), 1e-3)
    ranges = np.linalg.norm(made.r, axis=1) + np.random.default_rng(0).normal(0, 0.01, 150)
    start = first_guess(replace(made.problem, range_m=ranges, sigma_range=0.01))
    assert start.scaled
    checked(start, made, 3e-3, 5e-3, 0.03, 0.02)


def test_stereo_with_attitude_keeps_its_body_axes():
    made = with_attitude(scene(epochs=200), 1e-3)
    start = first_guess(made.problem)
    assert start.body_frame == "attitude0"
    checked(start, made, 3e-3, 3e-3, 0.02, 0.01)


def with_rates_only(made: Scene, sigma: float, seed: int = 0) -> Scene:
    rng = np.random.default_rng(seed)
    w = made.w + rng.normal(0, sigma, made.w.shape)
    problem = replace(made.problem, uv=made.problem.uv[:, :, :0], cameras=(), rates=w, sigma_rate=sigma)
    return replace(made, problem=problem)


def test_rates_alone():
    made = with_rates_only(scene(epochs=600), 1e-3 * 0.058)
    start = first_guess(made.problem)
    assert start.position is None and start.features is None
    checked(start, made, 0.02, 2e-3, None, 3e-3)


def test_one_camera_alone_says_what_is_missing():
    made = scene(epochs=50, cameras=1)
    with pytest.raises(NotPossible, match="attitude0"):
        first_guess(made.problem)


def test_two_features_are_not_enough():
    made = scene(epochs=50, features=2)
    with pytest.raises(NotPossible, match="three features"):
        first_guess(made.problem)


def test_features_on_a_line_are_not_enough():
    made = scene(epochs=50, features=4)
    world = made.r[:, None] + rotate(made.q[:, None], np.linspace(-1, 1, 4)[:, None] * np.array([1.0, 0, 0]))
    uv = np.stack([project(camera, world) for camera in made.problem.cameras], axis=1)
    with pytest.raises(NotPossible, match="line"):
        first_guess(replace(made.problem, uv=uv))


def test_free_windows_are_free_rotation():
    from massprops.dynamics.rigid_body import propagate
    from massprops.estimators.rates import _free

    inertia = np.array([[0.4, 0.02, 0.01], [0.02, 0.35, -0.03], [0.01, -0.03, 0.25]])
    rates = np.array([[0.3, -0.2, 0.5], [0.0, 0.1, 0.0]])
    tau = np.tile([-3.0, -1.2, 0.0, 0.4, 2.5], (2, 1))
    found = _free(tau, rates, inertia)
    for own, w in zip(found, rates, strict=True):
        start = np.array([1.0, 0, 0, 0])
        assert np.allclose(own[2], start)
        assert np.allclose(own[2:], propagate(start, w, inertia, tau[0, 2:])[0], atol=1e-6)
        assert np.allclose(own[2::-1], propagate(start, w, inertia, tau[0, 2::-1])[0], atol=1e-6)
