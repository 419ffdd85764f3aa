"""Whether a torque by the Sun's direction, of any form, is a rival of the effects that would be named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from massprops.diagnosis import candidate, criteria, unnamed, verdict
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.effects import effects
from massprops.errors import NotPossible

TRIED = 12


def _found(*names: str, wheel: bool = False, left: float = 1.2) -> Any:
    """Effects that leave so many times the stated noise."""
    terms = tuple(Term(effect=effects()[n]) for n in names)
    own = Hypothesis(terms=terms, latent=False, wheel=wheel)
    residual = np.full((400, 3), left)
    record = SimpleNamespace(stated=True)
    return SimpleNamespace(record=record, hypothesis=own, names=own.names, evidence=100.0, residual=residual)


def _asked(monkeypatch: pytest.MonkeyPatch, verified: float) -> list[Hypothesis]:
    """The hypotheses that are fitted from now on, each to a verified log evidence."""
    asked: list[Hypothesis] = []

    def fit(record: Any, hypothesis: Hypothesis, start: Any) -> Any:
        asked.append(hypothesis)
        return SimpleNamespace(verified=verified)

    monkeypatch.setattr(unnamed, "fit_hypothesis", fit)
    monkeypatch.setattr(unnamed, "again", lambda found: None)
    return asked


@pytest.mark.parametrize(("more", "leaves"), [(0.1, True), (-0.1, False)])
def test_beside_effects_it_must_be_likelier_by_enough(
    monkeypatch: pytest.MonkeyPatch, more: float, leaves: bool
) -> None:
    asked = _asked(monkeypatch, 100.0 + criteria.BEATS_UNKNOWN + more)
    found = _found("viscous-damping")
    assert unnamed.has_likelier_sun_torque(found, TRIED) is leaves
    assert asked == [Hypothesis(terms=found.hypothesis.terms, latent=False, by_sun=True)]


@pytest.mark.parametrize(("more", "leaves"), [(0.1, True), (-0.1, False)])
def test_in_place_of_sunlight_it_must_be_less_likely_by_enough(
    monkeypatch: pytest.MonkeyPatch, more: float, leaves: bool
) -> None:
    asked = _asked(monkeypatch, 100.0 - criteria.BEATS_UNKNOWN - np.log(1 + TRIED) + more)
    found = _found("viscous-damping", "solar-pressure-on-facets")
    assert unnamed.has_likelier_sun_torque(found, TRIED) is leaves
    assert asked == [Hypothesis(terms=found.hypothesis.terms[:1], latent=False, by_sun=True)]


def test_beside_effects_that_leave_only_noise_it_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = _asked(monkeypatch, 1000.0)
    assert not unnamed.has_likelier_sun_torque(_found("viscous-damping", left=1.0), TRIED) and not asked
    assert unnamed.has_likelier_sun_torque(_found("viscous-damping", "solar-pressure-on-facets", left=1.0), TRIED)


def test_a_wheel_stays_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = _asked(monkeypatch, 0.0)
    assert not unnamed.has_likelier_sun_torque(_found("solar-pressure-on-facets", wheel=True), TRIED)
    assert asked == [Hypothesis(latent=False, wheel=True, by_sun=True)]


def test_of_sunlight_alone_it_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = _asked(monkeypatch, 1000.0)
    assert not unnamed.has_likelier_sun_torque(_found("solar-pressure-on-facets"), TRIED) and not asked


def test_a_fit_that_fails_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(*_: Any) -> Any:
        raise NotPossible("no minimum")

    monkeypatch.setattr(unnamed, "fit_hypothesis", fit)
    monkeypatch.setattr(unnamed, "again", lambda found: None)
    assert not unnamed.has_likelier_sun_torque(_found("viscous-damping"), TRIED)


@pytest.mark.parametrize(("lead", "said"), [(4.0, "ambiguous"), (7.0, "named")])
def test_what_is_named_is_told_from_a_smooth_torque_of_any_form(
    lead: float, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of several effects one is a few likelier by chance. A torque that jumps as it likes with the Sun is another matter."""
    monkeypatch.setattr(verdict, "may_be_named", lambda c, base, *unknowns, lead=1.0: True)
    monkeypatch.setattr(candidate, "paid", lambda fit: fit.evidence)
    monkeypatch.setattr(verdict, "held_out_rms", lambda fit, noise: 1.0 if fit is found else 2.0)
    found = _found("constant-body-torque", left=1.0)
    base = SimpleNamespace(evidence=0.0, record=SimpleNamespace(stated=False))
    unknown = SimpleNamespace(evidence=found.evidence - lead, hypothesis=Hypothesis())
    jumping = SimpleNamespace(evidence=found.evidence - 1.0, hypothesis=Hypothesis(by_sun=True))
    assert verdict.verdict_of(base, (unknown, jumping), [candidate.Candidate(alone=found)])[0] == said  # type: ignore[arg-type]
