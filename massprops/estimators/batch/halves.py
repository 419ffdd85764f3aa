"""The inertia as each half of a record gives it, and the residuals in rows: what `judgement` asks of a batch fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import DIRECTIONS
from massprops.estimators.batch.solve import Fit, Search, covariance_of, fit
from massprops.estimators.result import Halves
from massprops.model.measurements import Measurements
from massprops.model.problem import Problem
from massprops.model.state import INERTIA, inertia_directions

MOST_ITERATIONS = 15
VAGUE = 0.1
"""Of a half's inertia along any direction, at trace 1: a half that says less is no witness."""


def halves(problem: Problem, m: Measurements, found: Fit, environment: EnvironmentModel) -> Halves | None:
    """Fits to the two halves of the measurements, each begun from the whole record's answer; None where one says
    nothing by itself or finds no rest."""
    middle, out = problem.times[len(problem.times) // 2], []
    for inside in (problem.times < middle, problem.times >= middle):
        part = fit(
            problem, _within(m, inside), found.state, environment, found.free, search=Search(most=MOST_ITERATIONS)
        )
        if not part.converged:
            return None
        inertia = part.state.inertia / 3.0
        J = np.einsum("aij,kij->ak", DIRECTIONS, inertia_directions(part.state.inertia)) / 3.0
        covariance = J @ covariance_of(part)[INERTIA, INERTIA] @ J.T
        if not np.isfinite(covariance).all() or np.sqrt(np.linalg.eigvalsh(covariance)[-1]) > VAGUE:
            return None
        out.append((np.einsum("aij,ij->a", DIRECTIONS, inertia), covariance))
    return out[0], out[1]


def _within(m: Measurements, inside: np.ndarray) -> Measurements:
    """The measurements of some epochs (n,)."""
    in_part = inside[m.seen.epoch]
    seen = replace(m.seen, **{name: getattr(m.seen, name)[in_part] for name in ("epoch", "camera", "feature", "row")})
    return replace(
        m, seen=seen, uv=m.uv[in_part], sigma=m.sigma[in_part], range_at=m.range_at[inside[m.range_at]],
        rate_at=m.rate_at[inside[m.rate_at]], attitude_at=m.attitude_at[inside[m.attitude_at]],
    )  # fmt: skip


def residual_rows(problem: Problem, m: Measurements, found: Fit) -> np.ndarray:
    """(n, 6 + 2 c m) residuals of rates, attitude and tracks in stated sigmas, NaN for none and for outliers."""
    n, (cameras, features) = len(problem.times), problem.seen.shape[1:]
    rates, attitude = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    tracks = np.full((n, cameras, features, 2), np.nan)
    residuals = found.residuals
    o, r, w = len(m.uv), len(m.range_at), len(m.rate_at)
    kept = found.weights > 0
    for channel_rows, values, at, weights in (
        (rates, residuals.rates, m.rate_at, kept[o + r : o + r + w]),
        (attitude, residuals.attitude, m.attitude_at, kept[o + r + w :]),
    ):
        channel_rows[at[weights]] = values[weights]
    here = kept[:o]
    tracks[m.seen.epoch[here], m.seen.camera[here], m.seen.feature[here]] = residuals.tracks[here]
    return np.concatenate([rates, attitude, tracks.reshape(n, -1)], axis=1)
