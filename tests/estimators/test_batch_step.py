"""Steps of the batch search, and rows of simulated pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.dynamics.rotation import six_of
from massprops.model import Model
from massprops.model.linearise import predict, residuals
from massprops.model.measurements import measurements_of
from massprops.model.problem import problem_of
from massprops.model.state import BatchState, inertia_directions, inertia_of, moved
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks


def test_a_turn_of_the_body_axes_moves_no_point_however_far_it_goes() -> None:
    rng = np.random.default_rng(3)
    inertia = inertia_of(np.array([[1.0, 0.1, 0.2], [0.1, 0.6, 0.0], [0.2, 0.0, 0.3]]))
    q0 = from_rotation_vector(rng.standard_normal(3))
    points = rng.standard_normal((4, 3))
    state = BatchState(q0, rng.standard_normal(3), np.zeros(3), np.zeros(3), inertia, Model(), points)
    turn = np.array([0.5, -0.3, 0.4])
    K = np.cross(np.eye(3), turn)
    ways = np.array([six_of(way) for way in inertia_directions(inertia)])
    change = np.linalg.solve(ways @ ways.T, ways @ np.array(six_of(inertia @ K - K @ inertia)))
    step = np.concatenate([turn, -np.cross(turn, state.w0), np.zeros(6), change])
    other = moved(state, step, points - np.cross(turn, points))
    before, after = rotation_matrix(state.q0), rotation_matrix(other.q0)
    assert np.abs(after - before).max() > 0.3
    assert np.allclose(other.points @ after.T, points @ before.T)
    assert np.allclose(after @ other.w0, before @ state.w0)
    assert np.allclose(after @ other.inertia @ after.T, before @ inertia @ before.T)


@pytest.mark.parametrize("effect", ["rolling-shutter:readout=2", "stereo-time-offset:offset=0.3"])
def test_a_simulated_row_is_taken_when_its_row_is(effect: str) -> None:
    scenario = TrackScenario(frames=40, distance_m=3.4, baseline_m=0.4, sigma_px=0.02, effects=(effect,), seed=5)
    made = simulate_tracks(scenario)
    problem = problem_of(made.sequence)
    m = measurements_of(problem)
    true = replace(made.state, points=made.state.points[problem.features])
    left = residuals(problem, m, predict(problem, true, EnvironmentModel(problem.environment)))
    assert np.sqrt(np.mean(left.tracks**2)) == pytest.approx(1.0, abs=0.1)
