"""What a prior of the inertia is worth: time until the error of k stays under 0.01, with and without; `make bench`.

With a prior a filter begins with a first guess from one second of footage. Without, it begins with one from as much
footage as serves it best: 4 s, 7 s, or two turns as `massprops estimate` does. No answer counts as had before its first
guess could be made. Runs that do not settle count as the record's length, which favours the side without.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from estimators.made_sequence import AXES, make_sequence

from massprops.estimators.filters.begin import early_start
from massprops.estimators.methods import smoother
from massprops.estimators.prior import FilterPrior, into_frame, judge
from massprops.estimators.result import Estimate, Prior
from massprops.estimators.start import first_guess
from massprops.mass.ratio_space import inertia_of
from massprops.model.problem import Problem, problem_of
from massprops.sequence import read_sequence

pytestmark = pytest.mark.bench

RUNS, EPOCHS, CLOSE = 20, 300, 0.01
WITHOUT = {"none, 4 s": 4.0, "none, 7 s": 7.0, "none, 2 turns": None}
FILTERS = ("ekf", "iekf", "ukf")
PRIORS = {"of a mesh": 0.02, "of both": 0.004, "wrong": 0.01}
"""1-sigma that the prior states of k1 and k2, of a mesh alone or of mesh and motion together; its error is drawn with it,
and of a wrong one 15 times as large."""


def settled(e: Estimate, true: np.ndarray, begun: float, end: float) -> float:
    """Time [s] from which k1 and k2 stay within `CLOSE`, not before `begun`; infinite where they do not."""
    assert e.k_history is not None
    late = e.times >= begun
    times, off = e.times[late], np.flatnonzero(~(np.abs(e.k_history[late] - true).max(axis=1) < CLOSE))
    if not len(off):
        return begun
    return np.inf if off[-1] == len(times) - 1 else float(times[off[-1] + 1])


def body(seed: int) -> tuple[np.ndarray, tuple[float, float, float]]:
    """Ratios of a box of three different sides, and a tumble at about 0.9 rad/s."""
    rng = np.random.default_rng([seed, 30])
    a, b, c = np.array([1.0, rng.uniform(0.65, 0.85), rng.uniform(0.35, 0.55)]) ** 2
    k = np.log([(b + c) / (a + c), (a + c) / (a + b)])
    way = rng.standard_normal(3) * [1.0, 1.6, 1.0]
    spin = 0.9 * way / np.linalg.norm(way)
    return k, (float(spin[0]), float(spin[1]), float(spin[2]))


def given_prior(kind: str, true: np.ndarray, seed: int) -> FilterPrior:
    rng, sigma = np.random.default_rng([seed, 7]), PRIORS[kind]
    off = sigma * rng.standard_normal(2) if kind != "wrong" else 15 * sigma * np.array([1.0, -0.7])
    points = np.random.default_rng(seed).uniform(-1, 1, (12, 3))  # as `make_sequence` draws them
    k = np.minimum(true + off, -1e-3)
    prior = Prior(
        inertia=inertia_of(k, AXES), k_sigma=np.full(2, sigma), axes_sigma=np.full(3, 0.005),
        features=points, feature_ids=np.arange(100, 112), feature_sigma=0.01,
    )  # fmt: skip
    return FilterPrior(prior, sigma**2 * np.eye(2), 0.005**2 * np.eye(3))


def one(problem: Problem, name: str, prior: Prior, start: object) -> Estimate:
    found: Estimate = import_module(f"massprops.estimators.methods.{name}").estimate(problem, prior, start)
    return found


def test_what_a_prior_is_worth_to_the_filters(tmp_path: Path) -> None:
    times: dict[tuple[str, str], list[float]] = {}
    innovation: dict[tuple[str, str], list[float]] = {}
    rejected = dict.fromkeys(PRIORS, 0)
    for seed in range(RUNS):
        true, spin = body(seed)
        problem = problem_of(
            read_sequence(make_sequence(tmp_path / str(seed), seed, epochs=EPOCHS, k=true, spin=spin, sigma_px=0.3))
        )
        end = float(problem.times[-1])
        whole = first_guess(problem)
        starts = {kind: first_guess(problem, until_s=s) for kind, s in WITHOUT.items() if s is not None}
        starts["none, 2 turns"] = early_start(problem, whole)
        soon = first_guess(problem, until_s=1.0)
        reference = smoother.estimate(problem, Prior(), whole)
        for kind, start in starts.items():
            for name in FILTERS:
                e = one(problem, name, Prior(), replace(whole, early=start))
                times.setdefault((kind, name), []).append(settled(e, true, float(start.times[-1]), end))
                innovation.setdefault((kind, name), []).append(e.innovation or np.nan)
        for kind in PRIORS:
            given = given_prior(kind, true, seed)
            rejected[kind] += judge(given, reference, whole, problem).verdict == "rejected"
            prior, tied = into_frame(given, soon, None, problem)
            assert tied == "features"
            for name in FILTERS:
                e = one(problem, name, prior, soon)
                times.setdefault((kind, name), []).append(settled(e, true, 1.0, end))
                innovation.setdefault((kind, name), []).append(e.innovation or np.nan)
    print(f"\n{RUNS} bodies, {end:.0f} s of stereo tracks; time [s] until the error of k1 and k2 stays under {CLOSE}")
    print("filter  prior           25 %   50 %   75 %  settled  innovation  sooner than without")
    middle = {key: float(np.median(np.minimum(values, end))) for key, values in times.items()}
    sooner = {(kind, name): min(middle[k, name] for k in WITHOUT) / m for (kind, name), m in middle.items()}
    for name in FILTERS:
        for kind in (*WITHOUT, *PRIORS):
            low, half, high = np.percentile(np.minimum(times[kind, name], end), [25, 50, 75])
            print(
                f"{name:<7} {kind:<14}{low:6.1f} {half:6.1f} {high:6.1f}  {np.isfinite(times[kind, name]).sum():3d}/{RUNS}"
                f"  {np.median(innovation[kind, name]):8.2f}  {sooner[kind, name]:12.1f}"
            )
    print("contradicted by the smoother and left out: " + ", ".join(f"{k} {n}/{RUNS}" for k, n in rejected.items()))
    assert rejected["wrong"] == RUNS and rejected["of both"] <= 1 and rejected["of a mesh"] <= 1
    for name in FILTERS:
        assert np.isfinite(times["wrong", name]).mean() >= 0.9, name  # overcome within the record
        assert sooner["of both", name] >= 3, name
