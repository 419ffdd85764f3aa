"""The Cramér-Rao bound that the smoother is held against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.campaigns.papers import smoother
from massprops.model.problem import problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks


def test_the_bound_falls_with_the_noise_and_with_more_cameras() -> None:
    scenario = TrackScenario(frames=80, rate_deg=4.0, features=24, range_sigma_m=0.0, assumed=False, seed=5)
    made = simulate_tracks(scenario)
    problem = problem_of(made.sequence)
    bound = smoother.bound_of(problem, made.state)
    assert np.allclose(smoother.bound_of(replace(problem, sigma_px=3.0 * problem.sigma_px), made.state), 3.0 * bound)
    single = simulate_tracks(replace(scenario, baseline_m=0.0))
    alone = smoother.bound_of(problem_of(single.sequence), single.state)
    assert (alone > bound).all(), "one camera whose lens is unknown shows less than two that are known"


@pytest.mark.parametrize("case", ["stereo", "attitude"])
def test_a_run_is_scored_against_its_bound(case: str) -> None:
    c = {**smoother.configuration(case), "frames": 120}
    (row,) = smoother.runs(c, [1])
    assert "error" not in row and row["converged"] and row["observable"]
    assert max(abs(row["z_k1"]), abs(row["z_k2"])) < 4.0
    assert row["z_k1"] == pytest.approx(row["error_k1"] / row["bound_k1"])
    table = smoother.table(case, [row, {"seed": 2, "error": "did not converge"}])
    assert "2 runs, seeds 1 to 2: 1 failed" in table["notes"][0]
