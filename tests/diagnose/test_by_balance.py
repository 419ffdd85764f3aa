"""Tracks by way of their attitudes: what the balance of momentum finds there is where a fit to the pixels begins."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.hypothesis_fit import Hypothesis, fit_hypothesis
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.search import by_balance
from massprops.diagnosis.search.by_balance import begun_by_balance, fits_by_balance
from massprops.diagnosis.search.case import Case, case_of
from massprops.diagnosis.selection import Candidate, Selection, rms
from massprops.effects import effects
from massprops.model.problem import problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

TORQUE = "constant-body-torque"


def case(**asked: object) -> Case:
    made = simulate_tracks(TrackScenario(frames=160, seed=3, **asked))  # type: ignore[arg-type]
    return case_of(problem_of(made.sequence))


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
    ((added, _),) = begun_by_balance(whole, [effects()[TORQUE]])
    assert [a.name for a in added] == [TORQUE]
    (found,) = fits_by_balance(whole, [effects()[TORQUE]], lambda *_: None, np.inf)
    assert found.fitted < 1.05 and found.fit.iterations <= 6
    assert begun_by_balance(whole, []) == [], "nothing but that may be named"


def test_the_attitudes_of_a_free_body_leave_nothing_to_begin_with() -> None:
    """Their sigmas say how far they are off, and what the sensors do wrong turns no body."""
    wrong = case(effects=("baseline-error:6",), assumed=False)
    assert wrong.shown is not None
    record = record_of_attitudes(wrong.shown, wrong.problem.environment)
    base = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    assert 0.8 < rms(base.residual) < 1.1
    assert begun_by_balance(wrong, list(effects().values())) == []


def test_without_an_attitude_at_the_first_epoch_there_is_no_start() -> None:
    assert begun_by_balance(case(baseline_m=0.0, rate_sigma=1e-4), list(effects().values())) == []
