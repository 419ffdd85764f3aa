"""A gyroscope whose axis stands still, and times that jump, are no measurement: one clear line, not an effect."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from massprops.diagnosis.diagnose import diagnose_by_balance
from massprops.diagnosis.document import _in_a_gap
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.motion_path import path_from_rates
from massprops.effects import effects
from massprops.errors import NotPossible
from massprops.estimators.estimate import estimate_all
from massprops.sensing.stuck_sensor import check_moving
from massprops.sensing.time_jumps import check_attitude_times, check_rate_times
from massprops.sequence import read_sequence
from massprops.sequence.data import RateSeries, Sequence

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
    stuck = Sequence(rates=RateSeries(np.round(TIMES * 1e9).astype(np.int64), w, None))
    for use in (diagnose_by_balance, estimate_all):
        with pytest.raises(NotPossible, match="stuck"):
            use(stuck)


def test_a_range_that_ends_for_a_few_samples_each_time_is_told() -> None:
    w = rates()
    top = np.quantile(w[:, 0], 0.97)
    with pytest.raises(NotPossible, match=r"rate about x reads .* in 12 samples and never beyond: .* end of its range"):
        check_moving(TIMES, np.minimum(w, top + 0.0 * w))
    low = np.round(np.maximum(w, np.quantile(w[:, 1], 0.05)) / 0.002) * 0.002
    with pytest.raises(NotPossible, match="never beyond"):
        check_moving(TIMES, low)


def test_an_axis_that_reads_one_number_all_the_time_is_told() -> None:
    w = rates()
    w[:, 2] = 3.25
    with pytest.raises(NotPossible, match="rate about z reads 3.25 rad/s in all 400 samples .* stuck"):
        check_moving(TIMES, w)
    calculated = np.stack([np.cos(TIMES), np.sin(TIMES), 0.5 + 0 * TIMES], axis=1)  # of a symmetric body
    check_moving(TIMES, calculated)
    check_moving(TIMES, np.round(calculated, 4))


JUMP = 0.06


@pytest.mark.parametrize("jump", [0.0, JUMP])
def test_rates_whose_clock_is_set_are_told_from_a_gap(jump: float) -> None:
    times = np.where(TIMES > 1.0, TIMES + jump, TIMES)
    if jump:
        with pytest.raises(NotPossible, match="imu0: the times jump by 0.065.* s at 0.99.* s, .* the clock was set"):
            check_rate_times(times, rates())
        return
    seen = (TIMES < 1.0) | (TIMES > 1.0 + JUMP)
    check_rate_times(TIMES[seen], rates()[seen])


@pytest.mark.parametrize("jump", [0.06, 3.0])
def test_attitudes_whose_clock_is_set_are_told_from_a_gap(jump: float) -> None:
    path = path_from_rates(TIMES, rates())
    q = path.q[np.searchsorted(path.t, TIMES - 1e-9)]
    with pytest.raises(NotPossible, match="attitude0: the times jump by .* the clock was set"):
        check_attitude_times(np.where(TIMES > 1.0, TIMES + jump, TIMES), q)
    for length in (0.03, 0.06, 0.3, 0.6):
        seen = (TIMES < 1.0) | (1.0 + length < TIMES)
        check_attitude_times(TIMES[seen], q[seen])


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


# -- a range that ends before noise comes on top --------------------------------------------------------------------------------------


def cut(top: float, noise: float = 0.01, seed: int = 1) -> np.ndarray:
    """(400, 3) of a tumble whose range ends at `top` [rad/s], with noise on top."""
    angle = 3.0 * TIMES[:, None] + np.array([0.0, 1.0, 2.0])
    return np.clip(5.0 * np.sin(angle), -top, top) + np.random.default_rng(seed).normal(0.0, noise, (len(TIMES), 3))


@pytest.mark.parametrize("top", [3.0, 4.0, 4.7])
def test_a_range_that_ends_below_noise_is_told(top: float) -> None:
    with pytest.raises(NotPossible, match=r"rate about . stays at -?\d.* such plateaus .* end of its range"):
        check_moving(TIMES, cut(top))


def test_extremes_of_a_tumble_are_no_plateaus() -> None:
    for seed in range(5):
        check_moving(TIMES, cut(10.0, seed=seed))


def test_a_wheel_that_is_driven_held_and_let_go_makes_one_plateau_and_is_none() -> None:
    """About its own axis a body that turns steadily keeps its rate until the wheel is driven, and while it is held."""
    history = np.interp(TIMES, [0.5, 0.8, 1.3, 1.6], [0.0, 1.0, 1.0, 0.0])
    w = np.stack([0.5 * np.cos(6.0 * TIMES), 0.5 * np.sin(6.0 * TIMES), 5.0 + history], axis=1)
    check_moving(TIMES, w + np.random.default_rng(3).normal(0.0, 0.01, w.shape))


def test_a_slow_turn_about_the_middle_axis_stays_near_its_extremes_and_bends() -> None:
    """Near the axis of the middle moment a body dwells, turns over and dwells: rates like a hyperbolic tangent."""
    t = np.linspace(-12.0, 12.0, 1200)
    w = np.stack([1.0 / np.cosh(t), np.tanh(3.0 * np.sin(0.6 * t)), 1.0 / np.cosh(t)], axis=1)
    for seed in range(5):
        check_moving(t, w + np.random.default_rng(seed).normal(0.0, 0.003, w.shape))


@pytest.mark.parametrize("folder", ["flights", "racquets"])
def test_real_gyroscopes_are_within_their_range(real_data: Path, folder: str) -> None:
    for record in sorted((real_data / folder).iterdir()):
        series = read_sequence(record).rates
        assert series is not None
        check_moving((series.timestamp_ns - series.timestamp_ns[0]) * 1e-9, series.w)
