"""Times that jump in the rates of a body that turns fast: what moves on over the gap was missed, what does not had its clock set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.test_turned_axes import seen

from massprops.diagnosis.diagnose import diagnose_by_balance
from massprops.diagnosis.set_clock import refuse_set_clock
from massprops.errors import NotPossible
from massprops.sensing.time_jumps import check_rate_times
from massprops.sequence.data import RateSeries, Sequence

MISSED = 4


def _rates(seed: int, kick: np.ndarray | None = None) -> RateSeries:
    """80 a second of a body that turns at 9 rad/s; kick: (3,) by which the rates jump in the middle [rad/s]."""
    series = seen("rates", np.zeros(3), seed, drag=0.2 * (seed == 1)).rates
    assert series is not None
    if kick is None:
        return series
    after = seen("rates", np.zeros(3), (seed + 1) % 3).rates
    assert after is not None
    middle = len(series.w) // 2
    # another tumble of the same body, from where it comes nearest to these rates and the kick
    wanted = series.w[middle] + kick
    at = int(np.argmin(np.linalg.norm(after.w[: middle // 2] - wanted, axis=1)))
    w = np.concatenate([series.w[:middle], after.w[at : at + middle]])
    return replace(series, w=w, timestamp_ns=series.timestamp_ns[: len(w)])


def _with_gap(series: RateSeries) -> RateSeries:
    """Without some samples in the middle."""
    k = len(series.w) // 2
    kept = np.r_[:k, k + MISSED : len(series.w)]
    return replace(series, w=series.w[kept], timestamp_ns=series.timestamp_ns[kept])


def _set_ahead(series: RateSeries, at: int | None = None) -> RateSeries:
    """With a clock that was set ahead by as much, in the middle or at a sample."""
    stamp, k = series.timestamp_ns.copy(), len(series.w) // 2 if at is None else at
    stamp[k:] += MISSED * (stamp[1] - stamp[0])
    return replace(series, timestamp_ns=stamp)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_clock_that_was_set_is_told_from_a_gap(seed: int) -> None:
    series = _rates(seed)
    refuse_set_clock(series)
    refuse_set_clock(_with_gap(series))
    with pytest.raises(NotPossible, match="imu0: the times jump by 0.0625 s at 0.4.* s, .* the clock was set"):
        refuse_set_clock(_set_ahead(series))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_kick_in_a_gap_is_no_clock(seed: int) -> None:
    refuse_set_clock(_with_gap(_rates(seed, kick=np.array([2.0, -1.5, 2.5]))))


def test_a_diagnosis_of_a_fast_body_asks_for_its_clock() -> None:
    """A line through the samples beside the gap does not tell where the rates bend."""
    series = _set_ahead(_rates(2), 20)
    check_rate_times(series.timestamp_ns * 1e-9, series.w)
    with pytest.raises(NotPossible, match="the clock was set"):
        diagnose_by_balance(Sequence(rates=series))
