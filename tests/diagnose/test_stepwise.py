"""Steps from a wrong choice: two effects at once are found though neither was chosen first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.diagnosis.search.assumed import contradicts
from massprops.diagnosis.search.case import Case, case_of
from massprops.diagnosis.search.refit import Added, FittedModel, refit, with_effects
from massprops.diagnosis.search.stepwise import stepwise
from massprops.effects import effects
from massprops.model import model_of
from massprops.model.problem import problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

QUIET = lambda what, done, total: None  # noqa: E731


def fitted(case: Case, base: FittedModel, *names: str) -> FittedModel:
    added = tuple(Added(effects()[n]) for n in names)
    return refit(case, with_effects(base.fit.state, added, {}), added)


@pytest.fixture(scope="module")
def damped_magnet() -> tuple[Case, FittedModel]:
    scenario = TrackScenario(
        frames=160, features=10, seed=7, rate_deg=4.0, effects=("viscous-damping:12", "magnetic-dipole-torque:6")
    )
    case = case_of(problem_of(simulate_tracks(scenario).sequence))
    return case, refit(case, case.first.state, (), most=40)


def test_an_effect_chosen_in_place_of_two_gives_way(damped_magnet: tuple[Case, FittedModel]) -> None:
    case, base = damped_magnet
    names = ("viscous-damping", "magnetic-dipole-torque", "constant-body-torque", "chaser-rotation-drift")
    wrong = fitted(case, base, "chaser-rotation-drift", "viscous-damping")
    steps = stepwise(case, wrong, [effects()[n] for n in names], QUIET)
    best = min(steps, key=lambda s: s.bic)
    assert set(best.names) == {"viscous-damping", "magnetic-dipole-torque"}
    assert best.fitted < 1.03 < wrong.fitted and best.held < 1.1 < wrong.held
    assert best.bic < wrong.bic - 100


def test_nothing_is_added_beside_what_is_enough(damped_magnet: tuple[Case, FittedModel]) -> None:
    case, base = damped_magnet
    right = fitted(case, base, "viscous-damping", "magnetic-dipole-torque")
    steps = stepwise(case, right, [e for e in effects().values() if getattr(e, "SEARCHED", True)][:3], QUIET)
    assert set(min(steps, key=lambda s: s.bic).names) == set(right.names)


def test_an_idle_effect_goes_where_nothing_is_added(damped_magnet: tuple[Case, FittedModel]) -> None:
    case, base = damped_magnet
    right = fitted(case, base, "viscous-damping", "magnetic-dipole-torque")
    idle = fitted(case, right, "viscous-damping", "magnetic-dipole-torque", "range-bias")
    assert abs(idle.fitted - right.fitted) < 1e-3
    assert set(stepwise(case, idle, [], QUIET)[-1].names) == set(right.names)


def test_an_inertia_off_by_more_than_chance_contradicts(damped_magnet: tuple[Case, FittedModel]) -> None:
    case, base = damped_magnet
    right = fitted(case, base, "viscous-damping", "magnetic-dipole-torque")
    assert case.inertia_prior.inertia is not None
    way = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 0.0]])
    for sigmas, wrong in ((0.0, False), (1.0, False), (4.0, True)):
        assumed = case.inertia_prior.inertia + sigmas * case.inertia_prior.sigma * way
        assert contradicts(replace(case, inertia_prior=replace(case.inertia_prior, inertia=assumed)), right) == wrong


def test_effects_act_in_the_order_in_which_a_model_file_is_read(damped_magnet: tuple[Case, FittedModel]) -> None:
    _, base = damped_magnet
    for names in (("lens-distortion", "focal-length-error"), ("focal-length-error", "lens-distortion")):
        state = with_effects(base.fit.state, tuple(Added(effects()[n]) for n in names), {})
        assert state.model.names == model_of({n: np.zeros(len(effects()[n].PARAMETERS)) for n in names}).names
