"""The smoother compared with the Cramér-Rao bound. It belongs to no paper, but the papers' filters are compared with it.

Each seed draws a body, its motion, its distance and the noise (`massprops.simulation.tracks`). The bound is the inverse of
the Fisher information of the same measurements at the true state, with everything unknown that the smoother estimates: attitude,
rates, path, inertia, every feature point, and with one camera its focal length and distortion. No unbiased estimate has
a smaller covariance. A smoother that gives no ratios although the bound is below its own limit has failed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.campaigns.consistency import consistency
from massprops.campaigns.papers._seeds import column, each_seed
from massprops.core.linalg import normalised_square
from massprops.core.robust import rms

PAPER = "smoother"
CASES = {
    "stereo": "two cameras' tracks and a range",
    "attitude": "attitudes alone, as structure from motion gives them",
    "one-camera": "one camera's tracks and a range, attitudes to begin with",
}
RUNS = {"stereo": 100, "attitude": 30, "one-camera": 30}
CHUNK = 5
BOXES = {case: ["z_k1", "z_k2", "chi2"] for case in CASES}
SEED = 3
WANTED = 1.2, (0.95, 1.05)
"""Rms error over the bound, and chi-square over freedom."""


def configuration(case: str) -> dict[str, Any]:
    """The whole set-up of a case as plain data; pairs are drawn between, evenly in the logarithm."""
    tracked = case != "attitude"
    return {
        "case": case,
        "frames": 300,
        "rate_hz": 2.0,
        "rate_deg": [1.5, 6.0],
        "distance_m": [6.0, 15.0],
        "sigma_px": [0.1, 1.0] if tracked else [0.3, 0.3],
        "features": {"stereo": 16, "one-camera": 40, "attitude": 0}[case],
        "baseline_m": 1.0 if case == "stereo" else 0.0,
        "range_sigma_m": 0.02 if tracked else 0.0,
        "attitude_sigma": [0.0, 0.0] if case == "stereo" else [0.001, 0.02],
    }


def runs(configuration: dict[str, Any], seeds: list[int]) -> list[dict[str, Any]]:
    """One row per seed: errors of k1, k2, their bounds and their ratio z, NEES, chi-square over freedom."""
    return each_seed(lambda seed: _run(configuration, seed), seeds)


def _run(c: dict[str, Any], seed: int) -> dict[str, Any]:
    from massprops.estimators.batch.outcome import LARGEST_SIGMA_K
    from massprops.estimators.estimate import estimate_all
    from massprops.simulation.track_scenario import TrackScenario
    from massprops.simulation.tracks import simulate_tracks

    rng = np.random.default_rng([SEED, seed])
    pairs = ("rate_deg", "distance_m", "sigma_px", "attitude_sigma")
    drawn: dict[str, Any] = {
        name: float(c[name][0] * (c[name][1] / c[name][0]) ** rng.random()) if c[name][0] else 0.0 for name in pairs
    }
    same = {name: c[name] for name in ("frames", "rate_hz", "features", "baseline_m", "range_sigma_m")}
    made = simulate_tracks(TrackScenario(**same, **drawn, assumed=False, seed=seed))
    outcome = estimate_all(made.sequence, ["smoother"])
    bound = bound_of(outcome.problem, made.state)
    row: dict[str, Any] = {"bound_k1": float(bound[0]), "bound_k2": float(bound[1])}
    shown = bound.max() <= LARGEST_SIGMA_K
    row["shown"] = int(shown)
    if not outcome.estimates:
        return {**row, "error": "; ".join(outcome.skipped.values())}
    estimate = outcome.estimates[0]
    row |= {"converged": int(estimate.converged), "observable": int(estimate.observable)}
    if estimate.innovation is not None:
        row["chi2"] = float(estimate.innovation)
    if estimate.k1 is None or estimate.k2 is None:
        return {**row, "error": estimate.reason} if shown else row
    if not estimate.converged:
        row["error"] = f"did not converge: {estimate.reason}"
    off = np.array([estimate.k1 - made.truth["k1"], estimate.k2 - made.truth["k2"]])
    row |= {"error_k1": float(off[0]), "error_k2": float(off[1])}
    row |= {"z_k1": float(off[0] / bound[0]), "z_k2": float(off[1] / bound[1])}
    if estimate.k_covariance is not None:
        row["nees"] = float(normalised_square(off, estimate.k_covariance))
    return row


def bound_of(problem: Any, state: Any) -> np.ndarray:
    """1-sigma of k1 and k2 (2,) that no unbiased estimate from these measurements can better.

    Args:
        problem: the measurements, of which only times, places and noises count. state: the true `BatchState`.
    """
    from dataclasses import replace

    from massprops.dynamics.environment import EnvironmentModel
    from massprops.estimators.batch.matched_tracks import LENS
    from massprops.estimators.batch.solve import reduced_equations
    from massprops.model import model_of
    from massprops.model.linearise import linearise, predict
    from massprops.model.measurements import measurements_of
    from massprops.model.state import ratio_jacobian

    tracked = problem.has_tracks
    single = tracked and not problem.stereo
    environment = EnvironmentModel(problem.environment)
    state = replace(
        state, points=state.points[problem.features], model=model_of(dict.fromkeys(LENS)) if single else state.model
    )
    m = measurements_of(problem, channels=("tracks", "range") if tracked else ("attitude",))
    free = np.ones(state.size, bool)
    if tracked:
        # attitude is counted from the body axes, which are free to choose
        free[:3], free[8] = False, problem.stereo or problem.has_range
    else:
        free[6:12] = False
    linear = linearise(problem, m, predict(problem, state, environment), environment)
    weights = np.ones(len(linear.residuals.norms))
    H = reduced_equations(linear, m, weights, free, state, None).H
    scale = np.sqrt(np.diag(H))
    values, vectors = np.linalg.eigh(H / scale[:, None] / scale)
    covariance = np.zeros((len(free), len(free)))
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    covariance[np.ix_(free, free)] = inverse / scale[:, None] / scale
    slopes = ratio_jacobian(state.inertia)[2]
    return np.asarray(np.sqrt(np.diag(slopes @ covariance[12:17, 12:17] @ slopes.T)))


def table(case: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Ours beside the bound."""
    failed = [r for r in rows if r.get("error")]
    scored = [r for r in rows if "z_k1" in r]
    lines: list[list[Any]] = []
    for k in ("k1", "k2"):
        z, error, bound = (column(scored, f"{name}_{k}") for name in ("z", "error", "bound"))
        if len(z):
            share = [float(x) for x in np.quantile(np.abs(z), (0.5, 0.9, 1.0), method="higher")]
            lines.append([f"{k}: error", float(np.median(np.abs(error))), float(np.median(bound)), rms(z), *share])
    both = np.concatenate([column(scored, "z_k1"), column(scored, "z_k2")])
    if len(both):
        lines.append(["both", None, None, rms(both)])
    chi2, nees = (column([r for r in scored if name in r], name) for name in ("chi2", "nees"))
    notes = [
        f"{len(rows)} runs, seeds {min(r['seed'] for r in rows)} to {max(r['seed'] for r in rows)}: {len(failed)} failed, "
        f"{sum(not r.get('shown', 1) for r in rows)} whose bound shows no ratios, {len(scored)} scored (a run that did "
        "not converge is failed and scored)",
        f"wanted: rms of error over bound at most {WANTED[0]}",
    ]
    if len(chi2):
        notes.append(
            f"chi-square over freedom: mean {chi2.mean():.4f}, {chi2.min():.3f} to {chi2.max():.3f}; "
            f"{int(((chi2 >= WANTED[1][0]) & (chi2 <= WANTED[1][1])).sum())} of {len(chi2)} in 0.95 to 1.05"
        )
    if len(nees):
        notes.append(consistency("smoother, k1, k2", nees, 2))
    columns = ["", "median |error|", "median bound", "rms error / bound", "50 %", "90 %", "100 %"]
    return {
        "title": f"smoother, {CASES[case]}: error against the bound",
        "columns": columns,
        "rows": lines,
        "notes": notes,
    }
