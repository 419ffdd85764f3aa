"""Whether a torque by the Sun's direction, of any form, explains more beside the effects that would be named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from massprops.diagnosis import criteria, selection
from massprops.diagnosis.hypothesis_fit import Hypothesis
from massprops.errors import NotPossible


@pytest.mark.parametrize(
    ("gain", "settled", "leaves"),
    [(criteria.BEATS_UNKNOWN + 0.1, True, True), (criteria.BEATS_UNKNOWN - 0.1, True, False), (50.0, False, False)],
)
def test_it_must_be_likelier_by_enough_and_settled(
    monkeypatch: pytest.MonkeyPatch, gain: float, settled: bool, leaves: bool
) -> None:
    asked: list[Hypothesis] = []

    def fit(record: Any, hypothesis: Hypothesis, start: Any) -> Any:
        asked.append(hypothesis)
        return SimpleNamespace(settled=settled, evidence=100.0 + gain)

    monkeypatch.setattr(selection, "fit_hypothesis", fit)
    monkeypatch.setattr(selection, "again", lambda found: None)
    found: Any = SimpleNamespace(record=None, hypothesis=Hypothesis(latent=False), evidence=100.0)
    assert selection.leaves_to_the_sun(found) is leaves
    assert asked == [Hypothesis(latent=False, by_sun=True)]


def test_a_fit_that_fails_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(*_: Any) -> Any:
        raise NotPossible("no minimum")

    monkeypatch.setattr(selection, "fit_hypothesis", fit)
    monkeypatch.setattr(selection, "again", lambda found: None)
    found: Any = SimpleNamespace(record=None, hypothesis=Hypothesis(), evidence=0.0)
    assert not selection.leaves_to_the_sun(found)
