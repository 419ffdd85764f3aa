"""The batch smoother: at the noise limit where the model holds, and silent where the motion shows nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprops.dynamics.quaternion import from_rotation_vector, multiply, rotation_matrix
from massprops.estimators.methods import smoother
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess
from massprops.model.problem import Problem, problem_of
from massprops.sequence import read_sequence, write_sequence
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

SENSORS = {
    "stereo": {},
    "attitude": {"features": 0, "attitude_sigma": 0.003, "range_sigma_m": 0.0},
    "rates": {"features": 0, "rate_sigma": 0.001, "range_sigma_m": 0.0},
}


def _run(**changes):
    made = simulate_tracks(TrackScenario(**{"frames": 200, "features": 10, **changes}))
    problem = problem_of(made.sequence)
    return made.truth, smoother.estimate(problem, Prior(), first_guess(problem))


@pytest.mark.parametrize("sensor", SENSORS)
def test_ratios_lie_within_their_sigmas(sensor: str) -> None:
    scores = []
    for seed in (0, 1, 2):
        truth, e = _run(seed=seed, outliers=0.005 if sensor == "stereo" else 0.0, **SENSORS[sensor])
        assert e.converged and e.observable, e.reason
        scores += list((np.array([e.k1, e.k2]) - [truth["k1"], truth["k2"]]) / e.sigma_k)
        assert 0.85 < e.innovation < 1.15
        assert e.sigma_k.max() < 0.05
    assert np.abs(scores).max() < 4 and np.sqrt(np.mean(np.square(scores))) < 2.0


def test_axes_and_motion_agree_with_truth() -> None:
    truth, e = _run(seed=4)
    body = rotation_matrix(e.q[0]).T @ rotation_matrix(truth["q"][0])
    axes = body @ np.array(truth["principal_axes"])
    cosine = np.abs(np.sum(axes * e.principal_axes, axis=0))
    assert np.degrees(np.arccos(cosine.clip(0, 1))).max() < 0.5
    assert np.linalg.norm(e.position - truth["position"], axis=1).max() < 0.02
    assert np.abs(e.w - truth["w"] @ body.T).max() < 2e-3


@pytest.mark.parametrize("spin", [(0, 0, 1), (1, 0, 0)])
def test_a_flat_spin_is_unobservable(spin) -> None:
    _, e = _run(seed=1, spin=spin)
    assert not e.observable and e.k1 is None and e.reason


def test_a_symmetric_body_has_no_axes() -> None:
    _, e = _run(seed=0, moments=(0.8, 0.8, 1.0))
    assert e.observable and abs(e.k1) < 3 * e.sigma_k[0]
    assert np.sqrt(np.diag(e.axes_covariance)).max() > 0.1, "a free turn about the axis of symmetry, up to the noise"


def test_a_model_with_the_effect_explains_what_free_rotation_does_not() -> None:
    made = simulate_tracks(TrackScenario(frames=200, features=10, seed=2, effects=("viscous-damping:6",)))
    problem = problem_of(made.sequence)
    start = first_guess(problem)
    plain = smoother.estimate(problem, Prior(), start)
    whole = smoother.estimate(problem, Prior(), start, made.model)
    assert plain.innovation > 1.5 and whole.innovation < 1.1
    error = np.abs(np.array([whole.k1, whole.k2]) - [made.truth["k1"], made.truth["k2"]])
    assert (error < 4 * whole.sigma_k).all()


def _drifting(problem: Problem) -> Problem:
    """Attitudes that go astray slowly, by far more than they state: the drift of a structure from motion."""
    phase = np.linspace(0, 2 * np.pi, len(problem.times))
    drift = 0.01 * np.column_stack([np.sin(phase), np.sin(2 * phase), np.cos(phase)])
    return replace(problem, attitude=multiply(problem.attitude, from_rotation_vector(drift)))


def test_attitudes_from_the_images_of_a_pair_do_not_count_beside_them() -> None:
    made = simulate_tracks(TrackScenario(frames=200, features=60, seed=6, attitude_sigma=1e-4, range_sigma_m=0.0))
    truth = np.array([made.truth["k1"], made.truth["k2"]])

    def score(problem: Problem) -> float:
        e = smoother.estimate(problem, Prior(), first_guess(problem))
        return float(np.abs((np.array([e.k1, e.k2]) - truth) / e.sigma_k).max())

    own = problem_of(made.sequence)
    astray = _drifting(own)
    assert own.stereo and score(own) < 4
    assert score(replace(astray, own_attitudes=False)) < 4 < score(astray)


def test_a_runs_attitudes_are_known_to_come_from_its_images(tmp_path: Path) -> None:
    made = simulate_tracks(TrackScenario(frames=40, features=12, seed=6, attitude_sigma=1e-3))
    write_sequence(tmp_path / "sequence", made.sequence)
    assert not read_sequence(tmp_path).of_run and problem_of(read_sequence(tmp_path)).own_attitudes
    (tmp_path / "run.yaml").write_text("format: massprops-run/1\n")
    assert read_sequence(tmp_path).of_run and not problem_of(read_sequence(tmp_path)).own_attitudes
