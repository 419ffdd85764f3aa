"""The loss of the batch smoother: an outlier costs what it would at the gate, so that leaving one out never pays."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from massprops.dynamics.environment import EnvironmentModel
from massprops.estimators.batch.solve import InertiaPrior, Search, costs_alike, fit, robust, spread_of, weighted_squares
from massprops.estimators.batch.track_weights import GATE, HUBER
from massprops.model.linearise import Residuals, predict, residuals
from massprops.model.measurements import Measurements, measurements_of
from massprops.model.problem import Problem, problem_of
from massprops.model.state import BatchState
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

SIZES = (0.5, 2.0, 2.9, 3.1, 4.0, 4.9, 5.1, 7.0, 20.0, 1e3, 1e6)
"""Residuals in units of the bulk's, across the gate."""
KINDS = ("tracks", "range", "rates", "attitude")


def loss(r: Residuals, m: Measurements) -> float:
    return robust(r, m)[1]


@cache
def scene() -> tuple[Problem, Measurements, BatchState]:
    """A record with every sensor, and its true state."""
    scenario = TrackScenario(frames=60, features=8, rate_sigma=0.001, attitude_sigma=0.003, seed=2)
    made = simulate_tracks(scenario)
    problem = problem_of(made.sequence)
    return problem, measurements_of(problem), replace(made.state, points=made.state.points[problem.features])


def off(r: Residuals, kind: str, size: float, bulk: float = 1.0) -> Residuals:
    """The residuals, all times `bulk`, with the first of a kind of so many times its noise."""
    values = {k: bulk * getattr(r, k) for k in KINDS}
    values[kind][0] = size
    return Residuals(**values)


def at_truth() -> tuple[Residuals, Measurements]:
    problem, m, true = scene()
    return residuals(problem, m, predict(problem, true, EnvironmentModel(problem.environment))), m


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bulk", [1.0, 4.0])
def test_a_measurement_costs_no_less_the_further_it_is_off_and_no_more_than_at_the_gate(kind: str, bulk: float) -> None:
    r, m = at_truth()
    cost = [loss(off(r, kind, bulk * size, bulk), m) for size in SIZES]
    assert (np.diff(cost) >= -1e-9 * cost[0]).all()
    outlying = off(r, kind, 1e6, bulk)
    weights = robust(outlying, m)[0]
    first = {k: sum(len(getattr(r, before)) for before in KINDS[:n]) for n, k in enumerate(KINDS)}[kind]
    assert weights[first] == 0.0 and cost[-1] > weighted_squares(outlying, weights)
    assert cost[-1] == pytest.approx(cost[SIZES.index(7.0)])
    part = getattr(r, kind).reshape(len(getattr(r, kind)), -1)
    scale = max(1.0, bulk * 1.3) ** 2
    assert cost[-1] - cost[0] <= HUBER * GATE * part.shape[1] * scale


def test_a_track_that_slides_costs_no_less_the_further_it_slides() -> None:
    r, m = at_truth()
    m = replace(m, may_slide=True)
    own = m.seen.feature == m.seen.feature[0]
    cost, left_out = [], []
    for size in np.linspace(1.0, 3.0, 21):
        slid = Residuals(np.where(own[:, None], size * r.tracks, r.tracks), r.range, r.rates, r.attitude)
        cost.append(loss(slid, m))
        left_out.append(bool((robust(slid, m)[0][: len(own)][own] == 0).all()))
    assert not left_out[0] and left_out[-1]
    assert (np.diff(cost) >= -1e-9 * cost[0]).all()
    assert cost[-1] == pytest.approx(cost[-2])


def test_without_outliers_the_loss_is_the_weighted_sum_of_squares() -> None:
    r, m = at_truth()
    weights, value = robust(r, m)
    assert (weights > 0).all() and value == pytest.approx(weighted_squares(r, weights), rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.0, 1e9), min_size=1, max_size=20))
def test_leaving_outliers_out_never_pays(sizes: list[float]) -> None:
    r, m = at_truth()
    tracks = r.tracks.copy()
    tracks[: len(sizes)] = np.array(sizes)[:, None]
    gated = replace(r, tracks=tracks)
    weights = robust(gated, m)[0]
    # the same, with each outlier as near as counts at all
    spread = max(1.0, float(np.median(gated.norms[: len(tracks)])) / 0.83)
    lost = weights[: len(tracks)] == 0
    tracks = np.where(lost[:, None], GATE * (1.0 - 1e-9) * spread, tracks)
    assert loss(gated, m) >= loss(replace(r, tracks=tracks), m) * (1.0 - 1e-9)


def test_a_fit_tells_what_its_outliers_cost() -> None:
    problem, m, true = scene()
    environment, free = EnvironmentModel(problem.environment, compiled=True), np.ones(true.size, bool)
    wrong = m.uv.copy()
    wrong[:5] += 300.0
    plain, with_outliers = (
        fit(problem, n, true, environment, free, InertiaPrior(), Search()) for n in (m, replace(m, uv=wrong))
    )
    assert (with_outliers.weights[:5] == 0).all()
    rise = with_outliers.cost - plain.cost
    assert rise == pytest.approx(0.5 * 5 * 2 * HUBER * GATE, rel=0.15)


def test_fits_are_compared_with_the_same_spread() -> None:
    """The bulk of one is a little larger by chance, what its outliers cost goes with the square of that, and it is no worse a fit."""
    r, m = at_truth()
    tracks = 1.2 * r.tracks
    tracks[:100] = 100.0
    one = replace(r, tracks=tracks)
    other = replace(r, tracks=np.where(np.arange(len(tracks))[:, None] < 100, 100.0, 0.999 * tracks))
    at_first, at_last = (spread_of(x.norms_by_kind)[0] for x in (one, other))
    assert 1.0 < at_last < at_first
    fits: Any = [SimpleNamespace(cost=0.5 * robust(x, m)[1], residuals=x) for x in (one, other)]
    alone, alike = np.array([f.cost for f in fits]), costs_alike(fits, m)
    of_outliers = 100 * HUBER * GATE * (at_first**2 - at_last**2)
    assert alike[1] == pytest.approx(alone[1])
    assert np.ptp(alone) - np.ptp(alike) == pytest.approx(of_outliers, rel=0.2)
    lost: Any = SimpleNamespace(cost=np.nan, residuals=one)
    assert np.isinf(costs_alike([fits[0], lost], m)).tolist() == [False, True]
