"""The inertia that is assumed: whether a fit contradicts it, and uneven density as what that says."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.search.candidate_fits import Watch
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.event_time import EVIDENCE
from massprops.diagnosis.search.refit import POLISH, Added, FittedModel, near, refit, with_effects
from massprops.estimators.batch.solve import prior_residuals

DENSITY = "nonuniform-density"
"""The effect that a contradicted inertia points at."""
CHANCE = 1e-4
"""Probability by chance of a departure of the inertia from what is assumed that contradicts it."""


def contradicts(case: Case, s: FittedModel) -> bool:
    """Whether a fit had to leave the inertia that is assumed: five numbers, as its size is given."""
    from scipy.special import chdtri  # scipy.stats takes a second to load

    if case.inertia_prior.inertia is None:
        return False
    value, _ = prior_residuals(s.fit.state, case.inertia_prior)
    return float(value @ value) > float(chdtri(5, CHANCE))


def with_assumed_inertia(case: Case, s: FittedModel) -> FittedModel:
    """The fit `s`, or one from the assumed inertia if that explains more: where an effect and the inertia can stand for each
    other, the search for the nearest to what is assumed is long."""
    if case.inertia_prior.inertia is None or not contradicts(case, s):
        return s
    firm = replace(case, inertia_prior=replace(case.inertia_prior, sigma=1e-2 * case.inertia_prior.sigma))
    held = refit(firm, replace(s.fit.state, inertia=case.inertia_prior.inertia), s.added, most=40)
    other = refit(case, held.fit.state, s.added, idle=POLISH)
    return other if other.bic < s.bic else s


def with_mass(case: Case, s: FittedModel, usable: list[ModuleType]) -> FittedModel | None:
    """The model with its inertia set free, where it explains the motion only by leaving the assumed one."""
    free = [m for m in usable if m.NAME == DENSITY and m.NAME not in s.names]
    if not free or case.inertia_prior.inertia is None or not contradicts(case, s):
        return None
    added = (*s.added, Added(free[0]))
    freed = refit(case, with_effects(replace(s.fit.state, inertia=case.inertia_prior.inertia), added, {}), added)
    return freed if s.bic - freed.bic > EVIDENCE and not freed.implausible else None


def density_with_each(
    case: Case, singles: list[FittedModel], usable: list[ModuleType], watch: Watch
) -> list[FittedModel]:
    """Uneven density together with each effect: fitted first and alone it bends to what the other does, and rests there."""
    density = [Added(m) for m in usable if m.NAME == DENSITY]
    out: list[FittedModel] = []
    for k, s in enumerate(singles):
        if density and DENSITY not in s.names:
            watch(f"uneven density beside {s.names[0]}", k, len(singles))
            added = (*s.added, *density)
            least = min((p.fit.cost for p in out), default=np.inf)
            out.append(refit(case, with_effects(s.fit.state, added, {}), added, against=near(least)))
    return sorted(out, key=lambda s: s.bic)
