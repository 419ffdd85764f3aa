"""Tracks by way of their attitudes: what the balance of momentum finds there is where a fit to the pixels begins."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import ModuleType

import numpy as np
import pytest

from massprops.core.robust import rms
from massprops.diagnosis.candidate import Candidate, Selection
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import fit_hypothesis
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.search import by_balance
from massprops.diagnosis.search.by_balance import ByBalance, fits_by_balance
from massprops.diagnosis.search.case import Case, case_of
from massprops.diagnosis.search.refit import refit
from massprops.effects import effects
from massprops.model.problem import problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

TORQUE = "constant-body-torque"


def case(**asked: object) -> Case:
    made = simulate_tracks(TrackScenario(frames=160, seed=3, **asked))  # type: ignore[arg-type]
    return case_of(problem_of(made.sequence))


def fitted(case: Case, usable: list[ModuleType]) -> ByBalance:
    return fits_by_balance(case, usable, lambda *_: None, np.inf)


def best_of(name: str, record: object, watch: object = None) -> Selection:
    """What a selection holds where one effect is tried over what its scan offers, and named."""
    ball = Start(inertia=np.eye(3), left=1.0)
    base = fit_hypothesis(record, Hypothesis(latent=False), ball)
    found = Candidate(alone=best_fit(record, effects()[name], base))
    return Selection(base=base, unknown=base, tried=(found,), verdict="named", named=(found,))


def torque_alone(record: object, watch: object = None) -> Selection:
    """What a selection holds where one effect is tried."""
    ball = Start(inertia=np.eye(3), left=1.0)
    fit = partial(fit_hypothesis, record, start=ball)
    base, unknown = fit(Hypothesis(latent=False)), fit(Hypothesis())
    term = Term(effect=effects()[TORQUE])
    tried = Candidate(alone=fit(Hypothesis(terms=(term,), latent=False)))
    return Selection(base=base, unknown=unknown, tried=(tried,), verdict="named", named=(tried,))


@pytest.mark.parametrize(
    "sensors", [{"assumed": False}, {"assumed": True}, {"assumed": False, "rate_sigma": 1e-4}], ids=str
)
def test_a_fit_to_the_pixels_begins_near_its_end(sensors: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the axes of the features, of `body.yaml` or of the gyroscope."""
    monkeypatch.setattr(by_balance, "select", torque_alone)
    whole = case(effects=(f"{TORQUE}:12",), **sensors)
    given = fitted(whole, [effects()[TORQUE]])
    (found,) = given.fits
    assert given.forced and [a.name for a in found.added] == [TORQUE]
    assert found.fitted < 1.05 and found.fit.iterations <= 6
    assert fitted(whole, []).fits == (), "nothing but that may be named"


def test_sunlight_on_faces_is_found_in_tracks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its parameters stay as the balance found them, under a prior that pixels have not, and count as many as are determined."""
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import seen_by_cameras

    name = "solar-pressure-on-facets"
    monkeypatch.setattr(by_balance, "select", partial(best_of, name))
    whole = case_of(problem_of(seen_by_cameras("sunlight", 1)))
    base = refit(whole, whole.first.state, ())
    (found,) = fitted(whole, [effects()[name]]).fits
    assert found.fitted < 1.05 and found.held < 1.12 < 2.0 < base.held
    (added,) = found.added
    assert 3.0 < added.given < 68.0 and not found.fit.free[17:].any()
    assert found.bic < base.bic - added.given * np.log(whole.fitted.count)


def test_an_effect_that_an_unknown_torque_beats_begins_no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing_named(record: object, watch: object = None) -> Selection:
        return replace(torque_alone(record), verdict="unexplained", named=())

    monkeypatch.setattr(by_balance, "select", nothing_named)
    found = fitted(case(effects=(f"{TORQUE}:12",)), [effects()[TORQUE]])
    assert found.fits == () and found.forced


def test_the_attitudes_of_a_free_body_leave_nothing_to_begin_with() -> None:
    """Their sigmas say how far they are off, and what the sensors do wrong turns no body."""
    wrong = case(effects=("baseline-error:6",), assumed=False)
    assert wrong.shown is not None
    record = record_of_attitudes(wrong.shown, wrong.problem.environment)
    base = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    assert 0.8 < rms(base.residual) < 1.1
    assert fitted(wrong, list(effects().values())).fits == ()


def test_without_an_attitude_at_the_first_epoch_there_is_no_start() -> None:
    assert fitted(case(baseline_m=0.0, rate_sigma=1e-4), list(effects().values())).fits == ()
