"""Simulated tracks, one estimator, and its errors against the truth.

Parameters are those of `massprops.simulation.track_scenario.TrackScenario`, `scenario` (several of them as one value, with a
`name`) and `estimator`. The same seed gives the same tracks to every estimator.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.campaigns.kinds import always, checked_by
from massprops.core.linalg import normalised_square
from massprops.documents.fields import read, unknown
from massprops.documents.loading import excerpt
from massprops.dynamics.quaternion import nearest_rotation
from massprops.errors import InputError, NotPossible

if TYPE_CHECKING:
    from massprops.estimators.result import Estimate
    from massprops.simulation.track_scenario import TrackScenario

SENTENCE = "Simulated tracks with any effects and noise, an estimator, and its errors against the truth."
OWN_THREADS = False
DEFAULT_ESTIMATOR = "smoother"
SETTLED = 0.5
"""State errors are taken over the last part of the span, from here on."""


def prepared(
    fixed: dict[str, Any], grid: dict[str, Any], folder: Path, where: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The reference estimator when none is named."""
    if "estimator" not in fixed and "estimator" not in grid:
        fixed = {**fixed, "estimator": DEFAULT_ESTIMATOR}
    return fixed, grid


def _scenario_keys() -> list[str]:
    from massprops.simulation.track_scenario import TrackScenario

    return [f.name for f in fields(TrackScenario) if f.name != "seed"]


def parameters(fixed: dict[str, Any], grid: dict[str, Any]) -> list[str]:
    """Names that may be set."""
    return ["scenario", "estimator", *_scenario_keys()]


def check(values: dict[str, Any], where: str) -> None:
    """Refuses unknown estimators and effects, and values out of range."""
    from massprops.estimators.methods import methods

    if not isinstance(values["estimator"], str) or values["estimator"] not in methods():
        raise unknown("estimator", values["estimator"], methods(), where)
    checked_by(lambda values: scenario_of(values, 0))(values, where)


def scenario_of(values: dict[str, Any], seed: int) -> TrackScenario:
    """What is simulated; single parameters go before those of `scenario`.

    Raises:
        InputError: an unknown name, or a value of the wrong kind or out of range.
    """
    from massprops.effects import effects
    from massprops.simulation.track_scenario import TrackScenario

    group = values.get("scenario") or {}
    if not isinstance(group, dict):
        raise InputError(f"scenario {excerpt(group)}: give parameters by name, for example {{name: slow, rate_deg: 1}}")
    known = _scenario_keys()
    for key in group:
        if key not in (*known, "name"):
            raise unknown("parameter of a scenario", key, known)
    chosen = {k: v for k, v in {**group, **values}.items() if k in known}
    named = chosen.get("effects") or ()
    chosen["effects"] = [named] if isinstance(named, str) else named
    if chosen.get("model") is not None:
        chosen["model"] = str(chosen["model"])
    scenario = read(TrackScenario, {**chosen, "seed": seed}, "scenario")
    for effect in scenario.effects:
        name = effect.partition(":")[0]
        if name not in effects():
            raise unknown("effect", name, effects())
    return scenario


default_runs = always(20)
chunk = always(2)
basis = always(None)


def runs(values: dict[str, Any], seeds: list[int], folder: Path | None) -> list[dict[str, Any]]:
    """Errors of each seed; what the data or the estimator cannot give is an error of that row alone."""
    return [_run(values, seed) for seed in seeds]


def _run(values: dict[str, Any], seed: int) -> dict[str, Any]:
    from massprops.estimators.estimate import estimate_all
    from massprops.simulation.tracks import simulate_tracks

    try:
        simulated = simulate_tracks(scenario_of(values, seed))
        outcome = estimate_all(simulated.sequence, [values["estimator"]])
    except NotPossible as stop:
        return {"error": f"not possible: {stop}"}
    if not outcome.estimates:
        return {"error": "not possible: " + "; ".join(outcome.skipped.values())}
    return errors(outcome.estimates[0], simulated.truth)


def errors(estimate: Estimate, truth: dict[str, Any]) -> dict[str, Any]:
    """Errors of an estimate against the truth, flat.

    Angular velocity is compared in the camera's frame, and attitude after the turn between the two choices of body axes
    (the mean over the span) is taken away, so that estimators with axes of their own are not at a disadvantage.

    Returns:
        `k1_error`, `k2_error` (ours minus true), `sigma_k1`, `sigma_k2`, `nees_k` (2 degrees of freedom), `w_deg_s`,
        `attitude_deg`, `position_m` (rms over the last half of the span), `converged`, `observable`, `innovation`.
    """
    row: dict[str, Any] = {"converged": int(estimate.converged), "observable": int(estimate.observable)}
    if estimate.k1 is not None and estimate.k2 is not None:
        off = np.array([estimate.k1 - truth["k1"], estimate.k2 - truth["k2"]])
        row |= {"k1_error": float(off[0]), "k2_error": float(off[1])}
        if estimate.k_covariance is not None and estimate.sigma_k is not None:
            row |= {"sigma_k1": float(estimate.sigma_k[0]), "sigma_k2": float(estimate.sigma_k[1])}
            row["nees_k"] = float(normalised_square(off, estimate.k_covariance))
    row |= _state_errors(estimate, truth)
    if estimate.innovation is not None:
        row["innovation"] = float(estimate.innovation)
    if estimate.cpu_us_per_step is not None:
        row["cpu_us_per_step"] = float(estimate.cpu_us_per_step)
    if not estimate.converged:
        row["error"] = f"did not converge: {estimate.reason}"
    return row


def _state_errors(estimate: Estimate, truth: dict[str, Any]) -> dict[str, float]:
    from massprops.dynamics.quaternion import rotate, rotation_matrix

    stamp = np.asarray(truth["timestamp_ns"])
    times = (stamp - stamp[0]) * 1e-9
    if not len(estimate.times):
        return {}
    at = np.clip(np.searchsorted(times, estimate.times - 1e-6), 0, len(times) - 1)
    late = estimate.times >= SETTLED * estimate.times[-1]
    row: dict[str, float] = {}
    if estimate.position is not None:
        row["position_m"] = _rms(estimate.position[late] - np.asarray(truth["position"])[at][late])
    if estimate.q is not None:
        q = np.asarray(truth["q"])[at]
        if estimate.w is not None:
            row["w_deg_s"] = float(
                np.degrees(_rms(rotate(estimate.q, estimate.w)[late] - rotate(q, np.asarray(truth["w"])[at])[late]))
            )
        between = np.swapaxes(rotation_matrix(estimate.q), -1, -2) @ rotation_matrix(q)
        mean = nearest_rotation(np.nanmean(between[late], axis=0))
        cosine = 0.5 * (np.einsum("nij,ij->n", between[late], mean) - 1.0)
        row["attitude_deg"] = float(np.degrees(np.sqrt(np.nanmean(np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2))))
    return row


def _rms(vectors: np.ndarray) -> float:
    """Root of the mean squared length of (n, 3)."""
    return float(np.sqrt(np.nanmean(np.sum(vectors**2, axis=1))))


def tables(plan: Any, points: list[Any]) -> list[dict[str, Any]]:
    """Root-mean-square errors and consistency, one line per point."""
    rows = []
    for p in points:
        k1, k2 = p.values("k1_error"), p.values("k2_error")
        nees = p.values("nees_k")
        medians = [_median(p.values(name)) for name in ("w_deg_s", "attitude_deg", "position_m")]
        rows.append(
            [p.label, len(p.rows), p.failed, len(p.rows) - p.failed - len(k1)]
            + [
                _median(np.abs(k1)),
                _root(k1),
                _median(np.abs(k2)),
                _root(k2),
                float(nees.mean()) if len(nees) else None,
            ]
            + medians
        )
    columns = ["", "runs", "failed", "unobservable", "|k1 error| median", "rms", "|k2 error| median", "rms"]
    columns += ["NEES of k (2)", "w [deg/s]", "attitude [deg]", "position [m]"]
    note = f"State errors: rms over the last {100 * (1 - SETTLED):.0f} % of the span, median over the runs."
    return [{"title": "Errors against the truth", "columns": columns, "rows": rows, "notes": [note]}]


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) else None


def _root(values: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(np.sort(values**2)))) if len(values) else None


TITLES = {
    "k1_error": "error of k1",
    "k2_error": "error of k2",
    "sigma_k1": "stated 1-sigma of k1",
    "sigma_k2": "stated 1-sigma of k2",
    "nees_k": "NEES of k1 and k2 together (2 expected)",
    "w_deg_s": "error of the angular velocity [deg/s]",
    "attitude_deg": "error of the attitude [deg]",
    "position_m": "error of the position [m]",
    "innovation": "squared innovations over what they should be",
}
boxes = always(["k1_error", "k2_error", "nees_k", "w_deg_s", "attitude_deg", "position_m"])
