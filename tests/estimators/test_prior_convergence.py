"""What a prior is worth to filters that begin after one second of footage; `make bench` prints the table."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from estimators.made_sequence import AXES, TRUE_K, make_sequence

from massprops.estimators.prior import FilterPrior, into_frame
from massprops.estimators.problem import problem_of
from massprops.estimators.result import Estimate, Prior
from massprops.estimators.start import first_guess
from massprops.mass.ratio_space import inertia_of
from massprops.sequence import read_sequence

pytestmark = pytest.mark.bench

FILTERS = ("ekf", "iekf", "ukf")


def settled(e: Estimate) -> float:
    """Time [s] from which the error of k1 and k2 stays under 0.01; infinite when it does not by the end."""
    assert e.k_history is not None
    off = np.flatnonzero(~(np.abs(e.k_history - TRUE_K).max(axis=1) < 0.01))
    if not len(off):
        return float(e.times[1])
    return np.inf if off[-1] == len(e.times) - 1 else float(e.times[off[-1] + 1])


def test_filters_converge_three_times_sooner_and_overcome_a_wrong_prior(tmp_path: Path) -> None:
    times: dict[tuple[str, str], list[float]] = {}
    noticed: dict[tuple[str, str], list[float]] = {}
    for seed in range(6):
        sequence = read_sequence(make_sequence(tmp_path / str(seed), seed, epochs=300, sigma_px=0.3))
        problem, rng = problem_of(sequence), np.random.default_rng([seed, 7])
        start = first_guess(problem, Prior(), until_s=1.0)
        points = np.random.default_rng(seed).uniform(-1, 1, (12, 3))
        for kind, k in (
            ("none", None),
            ("right", TRUE_K + 0.003 * rng.standard_normal(2)),
            ("wrong", TRUE_K + [0.15, -0.1]),
        ):
            prior = Prior()
            if k is not None:
                given = Prior(
                    inertia=inertia_of(k, AXES), k_sigma=np.full(2, 0.004), axes_sigma=np.full(3, 0.005),
                    features=points, feature_ids=np.arange(100, 112), feature_sigma=0.01,
                )  # fmt: skip
                prior, tied = into_frame(FilterPrior(given), start, None, problem)
                assert tied == "features"
            for name in FILTERS:
                e = import_module(f"massprops.estimators.methods.{name}").estimate(problem, prior, start)
                times.setdefault((kind, name), []).append(settled(e))
                noticed.setdefault((kind, name), []).append(e.innovation or np.nan)
    print("\nfilter  prior   settled [s], median and all                     mean squared innovation")
    for (kind, name), values in times.items():
        shown = ", ".join(f"{v:.1f}" for v in values)
        print(f"{name:<7} {kind:<7} {np.median(values):6.1f}  ({shown})  {np.median(noticed[kind, name]):.2f}")
    for name in FILTERS:
        assert np.median(times["none", name]) >= 3 * np.median(times["right", name])
        assert np.isfinite(times["wrong", name]).mean() >= 5 / 6  # overcome within the 30 s
        assert np.median(noticed["wrong", name]) > 1.1 * np.median(noticed["right", name])  # and noticed
