"""The moment of an effect that moves the tracks at once is found to the gap between two epochs."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.diagnosis.search.case import Case, case_of
from massprops.diagnosis.search.event_time import EVIDENCE, best_event_time
from massprops.diagnosis.search.refit import Added, FittedModel, refit, with_effects
from massprops.diagnosis.search.score import score_tests
from massprops.diagnosis.search.stepwise import stepwise
from massprops.effects import effects
from massprops.model.problem import problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

CHANGE = "inertia-change"
QUIET = lambda what, done, total: None  # noqa: E731


@pytest.fixture(scope="module")
def deployed() -> tuple[Case, FittedModel, float]:
    """A record with an inertia change, its base model, and the true moment."""
    scenario = TrackScenario(frames=120, features=8, seed=4, rate_deg=4.0, effects=(f"{CHANGE}:4",))
    made = simulate_tracks(scenario)
    case = case_of(problem_of(made.sequence))
    return case, refit(case, case.first.state, (), most=40), made.truth["effects"][CHANGE]["time"]


def gap(case: Case, moment: float) -> int:
    return int(np.searchsorted(case.problem.times, moment))


def moment_of(s: FittedModel) -> float:
    return float(s.fit.state.model.value(CHANGE)[0])


def at(case: Case, base: FittedModel, moment: float) -> FittedModel:
    """The fit with the moment held."""
    added = (Added(effects()[CHANGE]),)
    values = {CHANGE: np.array([moment, *[0.0] * 12])}
    return refit(case, with_effects(base.fit.state, added, values), added, hold="time")


def test_a_moment_one_epoch_off_is_put_right(deployed: tuple[Case, FittedModel, float]) -> None:
    case, base, true = deployed
    times, right = case.problem.times, gap(case, true)
    late = at(case, base, float(times[right : right + 2].mean()))
    assert gap(case, moment_of(late)) == right + 1
    best = stepwise(case, late, [], QUIET)[-1]
    assert gap(case, moment_of(best)) == right
    assert best.bic < late.bic - EVIDENCE


def test_a_moment_far_off_is_found(deployed: tuple[Case, FittedModel, float]) -> None:
    case, base, true = deployed
    wrong = at(case, base, true + 12.0)
    assert moment_of(wrong) == true + 12.0
    best = best_event_time(case, wrong)
    assert gap(case, moment_of(best)) == gap(case, true)
    assert best.fitted < 1.03 < wrong.fitted


def test_the_score_of_a_move_is_what_the_move_is_worth(deployed: tuple[Case, FittedModel, float]) -> None:
    case, base, true = deployed
    near, right = at(case, base, true + 2.0), at(case, base, true)
    values = [np.array([true + d, *[0.0] * 12]) for d in (0.0, 5.0)]
    there, beyond = score_tests(case, near, [(near.added[0], v) for v in values], CHANGE)
    assert there.gain == pytest.approx(2 * (near.fit.cost - right.fit.cost), rel=0.25)
    assert beyond.gain < 0
