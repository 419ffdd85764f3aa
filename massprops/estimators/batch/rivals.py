"""Other inertias that a nearly flat spin allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import ratios
from massprops.estimators.batch.outcome import LARGEST_SIGMA_K
from massprops.estimators.batch.solve import Fit, InertiaPrior, costs_alike, fit
from massprops.geometry.vectors import unit
from massprops.model.measurements import Measurements
from massprops.model.problem import Problem

NEARLY_FLAT = 0.15
"""Largest turn [rad] of the angular velocity in the body below which rival inertias are tried."""
RIVAL_CHI2 = 12.0
"""Difference of chi-square within which a rival explains the data as well."""


def best_of_rivals(
    problem: Problem, m: Measurements, found: Fit, environment: EnvironmentModel, inertia_prior: InertiaPrior
) -> tuple[Fit, str | None]:
    """The best of fits that begin with other inertias, and what is said when one differs but explains as much.

    Near a flat spin the linear covariance holds at one answer and says nothing of the others; elsewhere the fit stands.
    """
    if not _turn_in_body(found.predicted.motion.w) < NEARLY_FLAT:
        return found, None
    moments, axes = np.linalg.eigh(found.state.inertia)
    along = int(np.argmax(np.abs(axes.T @ found.state.w0)))
    others = [i for i in range(3) if i != along]
    starts = [np.eye(3)]
    for place in range(3):
        new = np.empty(3)
        rest = np.delete(moments, place)
        new[along], new[others[0]], new[others[1]] = moments[place], rest[0], rest[1]
        starts.append((axes * new) @ axes.T)
    fits = [found]
    best = found
    for inertia in starts:
        other = fit(problem, m, replace(found.state, inertia=inertia), environment, found.free, inertia_prior)
        if not np.isfinite(other.cost):
            continue
        fits.append(other)
        costs = costs_alike(fits, m)
        best = fits[int(np.argmin(costs))]
        k = ratios(best.state.inertia)[0]
        for f, more in zip(fits, costs - costs.min(), strict=True):
            off = np.max(np.abs(ratios(f.state.inertia)[0] - k))
            if 2 * more < RIVAL_CHI2 and off > LARGEST_SIGMA_K:
                return best, "bodies of quite different inertia explain this motion as well: it is nearly a flat spin"
    return best, None


def _turn_in_body(w: np.ndarray) -> float:
    """Largest angle [rad] of the angular velocity in the body from its mean direction."""
    way = unit(w)
    mean = way.mean(axis=0)
    return float(np.arccos(np.clip(np.min(way @ mean) / max(float(np.linalg.norm(mean)), 1e-300), -1, 1)))
