"""A gyroscope whose axis stands still is no measurement: one clear line, not an effect."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from massprops.diagnosis.document import _in_a_gap
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.hypothesis_fit import Hypothesis
from massprops.diagnosis.record import record_of_rates
from massprops.diagnosis.stuck_sensor import check_moving
from massprops.effects import effects
from massprops.errors import NotPossible
from massprops.sequence.data import RateSeries

TIMES = np.linspace(0.0, 2.0, 400)


def rates(step: float = 0.0) -> np.ndarray:
    """(400, 3) of a tumble with noise, in counts of `step` [rad/s] where that is not 0."""
    angle = 3.0 * TIMES[:, None] + np.array([0.0, 1.0, 2.0])
    w = 5.0 * np.sin(angle) + np.random.default_rng(1).normal(0.0, 0.01, (len(TIMES), 3))
    return np.round(w / step) * step if step else w


def test_a_range_that_ends_and_a_sensor_that_is_stuck_are_told() -> None:
    with pytest.raises(NotPossible, match="rate about x reads .* at the end of its range"):
        check_moving(TIMES, np.clip(rates(), -4.0, 4.0))
    w = rates()
    w[100:150, 1] = w[100, 1]
    with pytest.raises(NotPossible, match="rate about y reads .* in 50 samples in a row from 0.5013 s on: .* stuck"):
        check_moving(TIMES, w)
    with pytest.raises(NotPossible, match="stuck"):
        record_of_rates(RateSeries(np.round(TIMES * 1e9).astype(np.int64), w, None))


def test_an_event_in_a_gap_may_be_times_that_jump() -> None:
    times = np.concatenate([np.arange(0.0, 100.0, 2.0), np.arange(120.0, 300.0, 2.0)])

    def said(**held: float) -> list[str]:
        term = Term(effect=effects()["impulse"], held=tuple(sorted(held.items())))
        best = SimpleNamespace(record=SimpleNamespace(times=times), hypothesis=Hypothesis(terms=(term,)))
        return _in_a_gap(SimpleNamespace(best=best))  # type: ignore[arg-type]

    assert "gap of 22 s" in said(time=110.0)[0] and "gap of 22 s" in said(time=97.0, duration=30.0)[0]
    assert not said(time=50.0, duration=4.0) and not said(time=299.0, duration=40.0)


@pytest.mark.parametrize("step", [0.0, 0.02, 0.5])
def test_coarse_counts_and_axes_that_never_move_are_measurements(step: float) -> None:
    check_moving(TIMES, rates(step))
    check_moving(TIMES, rates(step) * [1.0, 0.0, 1.0])
