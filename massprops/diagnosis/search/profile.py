"""Uncertainty of an effect with a pace, by the profile of its likelihood."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import POLISH, FittedModel, refit, with_value
from massprops.diagnosis.search.residual_statistics import count
from massprops.effects import places_of

SHORTEST, LONGEST = 0.1, 0.5
"""Logarithm of the factor between one pace and the next that is tried."""
MOST = 8
"""Paces tried on either side."""


def profiled(case: Case, s: FittedModel) -> FittedModel:
    """The fit with 1-sigma of its effects' parameters no smaller than they move until chi-square has risen by one, as a
    pace is held ever slower, and ever faster (profile likelihood, Venzon and Moolgavkar 1988).

    Where slow and fast versions of an effect look alike, the valley of the misfit bends: the curvature at its lowest
    place, which sigma otherwise comes from, says little of how far it goes.
    """
    sigma = dict(s.sigma)
    for a in s.added:
        for place in places_of(a.effect, "pace"):
            pace, spread = s.fit.state.model.value(a.name)[place], s.sigma[a.name][place]
            if not pace > 0 or not np.isfinite(spread):
                continue
            factor = float(np.exp(np.clip(spread / pace, SHORTEST, LONGEST)))
            for way in (factor, 1.0 / factor):
                away = _until_worse(case, s, a.effect, place, way)
                sigma = {name: np.maximum(sigma_before, away[name]) for name, sigma_before in sigma.items()}
    return replace(s, sigma=sigma)


def _until_worse(case: Case, s: FittedModel, effect: ModuleType, place: int, factor: float) -> dict[str, np.ndarray]:
    """How far the parameters of the effects, but for moments, have moved when chi-square has risen by one."""
    at, rise = s, 0.0
    for _ in range(MOST):
        pace = at.fit.state.model.value(effect.NAME)[place]
        begun = with_value(at.fit.state, effect, place, pace * factor)
        tried = refit(case, begun, s.added, idle=POLISH, hold="pace")
        if not np.isfinite(tried.fit.cost):
            break
        at = tried
        rise = count(s.fit.residuals) * np.log(at.fit.cost / s.fit.cost)
        if rise >= 1.0:
            break
    # beyond one, chi-square rises about as the square
    share = 1.0 / np.sqrt(max(1.0, rise))
    return {
        m.NAME: np.array(
            [0.0 if q.kind == "time" else abs(y - x) * share for q, x, y in zip(m.PARAMETERS, v, w, strict=True)]
        )
        for m, v, w in zip(s.fit.state.model.modules, s.fit.state.model.values, at.fit.state.model.values, strict=True)
    }
