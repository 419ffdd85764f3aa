"""Friction inside the body: from slow to fast the valley of the misfit bends, and what is told of it stays honest."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.diagnosis.search.candidate_fits import fit_candidates
from massprops.diagnosis.search.case import Case, case_of
from massprops.diagnosis.search.profile import profiled
from massprops.diagnosis.search.refit import FittedModel, refit, with_effects
from massprops.diagnosis.search.residual_statistics import count
from massprops.effects import effects
from massprops.model.problem import problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

FRICTION = "energy-dissipation"
QUIET = lambda what, done, total: None  # noqa: E731


@pytest.fixture(scope="module")
def friction() -> tuple[Case, FittedModel, np.ndarray]:
    """A record with friction, its best fit, and the true share and coupling."""
    made = simulate_tracks(TrackScenario(frames=160, features=10, seed=3, rate_deg=4.0, effects=(f"{FRICTION}:5",)))
    case = case_of(problem_of(made.sequence))
    base = refit(case, case.first.state, (), most=40)
    best = fit_candidates(case, base, [effects()[FRICTION]], 1, QUIET, "")[0]
    best = refit(case, best.fit.state, best.added, most=100, idle=1e-3)
    return case, best, np.array(list(made.truth["effects"][FRICTION].values()))


def test_sigma_reaches_to_where_chi_square_has_risen_by_one(friction: tuple[Case, FittedModel, np.ndarray]) -> None:
    case, best, true = friction
    found, curved = best.fit.state.model.value(FRICTION), best.sigma[FRICTION]
    sigma = profiled(case, best).sigma[FRICTION]
    assert (sigma >= curved).all() and (np.abs(found - true) < 3 * sigma).all()
    rises = []
    for pace in (found[1] + sigma[1], max(found[1] - sigma[1], 0.05 * found[1])):
        held = with_effects(best.fit.state, best.added, {FRICTION: np.array([found[0] * found[1] / pace, pace])})
        there = refit(case, held, best.added, most=60, idle=1e-3, hold="pace")
        rises.append(count(best.fit.residuals) * np.log(there.fit.cost / best.fit.cost))
    assert max(rises) > 0.4, "sigma is too small: chi-square has hardly risen on either side"
    assert min(rises) < 2.0, "sigma is too large: chi-square has risen by more than one on both sides"


def test_a_fit_without_a_pace_is_left_as_it_is(friction: tuple[Case, FittedModel, np.ndarray]) -> None:
    case, _, _ = friction
    damped = fit_candidates(
        case, refit(case, case.first.state, (), most=40), [effects()["viscous-damping"]], 1, QUIET, ""
    )
    assert profiled(case, damped[0]).sigma == damped[0].sigma
