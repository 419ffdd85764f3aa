"""Where the batch search begins, and how far a step of it may go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.dynamics.environment import EnvironmentModel
from massprops.estimators.batch import solve
from massprops.estimators.batch.solve import MOST_QUICKENED, MOST_TURNED, Search, fit
from massprops.estimators.batch.start import _first_steady, batch_start
from massprops.estimators.start import Start, first_guess
from massprops.model.linearise import Predicted, predict
from massprops.model.measurements import measurements_of
from massprops.model.problem import Problem, problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks


@pytest.fixture(scope="module")
def guessed() -> tuple[Problem, Start, float]:
    """A tumbling body's record, its first guess, and the true speed at the beginning [rad/s]."""
    made = simulate_tracks(TrackScenario(frames=120, features=8, seed=4, rate_deg=4.0))
    problem = problem_of(made.sequence)
    return problem, first_guess(problem), float(np.linalg.norm(made.state.w0))


def test_rates_at_the_ends_that_mean_nothing_do_not_lead_astray(guessed: tuple[Problem, Start, float]) -> None:
    problem, start, speed = guessed
    w = start.w.copy()
    w[:3] *= 40.0
    assert start.inertia is not None
    assert 3 <= _first_steady(start.times, start.q, w, start.inertia) < 40
    begun = batch_start(problem, replace(start, w=w), EnvironmentModel(problem.environment))
    assert np.linalg.norm(begun.state.w0) == pytest.approx(speed, rel=0.03)


def test_a_wild_step_is_turned_back_before_its_motion_is_followed(
    guessed: tuple[Problem, Start, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, start, _ = guessed
    environment = EnvironmentModel(problem.environment)
    begun = batch_start(problem, start, environment)
    followed, refused = [], []
    honest = solve._step

    def wild(reduced, damping, free, state):  # type: ignore[no-untyped-def]
        d, points = honest(reduced, damping, free, state)
        if len(refused) < 3:
            d[3:6] = 1e9
            refused.append(damping)
        return d, points

    def watched(problem, state, environment) -> Predicted:  # type: ignore[no-untyped-def]
        followed.append(float(np.linalg.norm(state.w0)))
        return predict(problem, state, environment)

    monkeypatch.setattr(solve, "_step", wild)
    monkeypatch.setattr(solve, "predict", watched)
    found = fit(
        problem,
        measurements_of(problem, observed=begun.observed),
        begun.state,
        environment,
        begun.free,
        search=Search(most=12),
    )
    allowed = MOST_QUICKENED * np.linalg.norm(begun.state.w0) + MOST_TURNED / np.ptp(problem.times)
    assert refused and max(followed) <= allowed
    assert found.chi2 < 1.3 * found.freedom
