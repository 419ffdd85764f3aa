"""Forward steps from a model, each with a backward check, and exchanges of one effect for another."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.search.acceptance import WORSE, explained, penalised_bic
from massprops.diagnosis.search.assumed import DENSITY, with_assumed_inertia, with_mass
from massprops.diagnosis.search.candidate_fits import FITS_OF_A_PAIR, Watch, fit_candidates
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.event_time import EVIDENCE, best_event_time
from massprops.diagnosis.search.refit import MOST_ITERATIONS, POLISH, Added, FittedModel, near, refit, with_effects
from massprops.diagnosis.search.residual_statistics import count
from massprops.effects import has_pace, searched
from massprops.model.state import BODY_SIZE

MOST_EFFECTS = 2
"""Effects at once that are sought; a third stands beside them only until one of the three is idle."""
EXCHANGES = 2
"""Effects that are fitted in place of each of two."""


def stepwise(case: Case, start: FittedModel, usable: list[ModuleType], watch: Watch) -> list[FittedModel]:
    """Models on the way from `start` to one beside which no effect is worth its parameters, and what comes near that.

    Each step adds the effect that explains most of what is left, then takes away the one that became idle: what was
    chosen first, to stand for two effects, gives way when both are there. At the end each of two is exchanged for others.
    """
    models = [
        with_assumed_inertia(
            case, best_event_time(case, refit(case, start.fit.state, start.added, idle=POLISH), far=False)
        )
    ]

    def follow(s: FittedModel) -> None:
        if s is not models[-1]:
            models.append(s)

    follow(lean(case, models[-1]))
    while (better := _grown(case, models[-1], usable, watch)) is not None:
        models.append(better)
    for a in models[-1].added:
        plain = _simpler(case, models[-1], a) if a.form else None
        if plain is not None and plain.bic < models[-1].bic and _may_follow(plain, models[-1]):
            models.append(plain)
    if len(models) > 1:
        follow(best_event_time(case, models[-1], far=False))
        follow(_best_rate_constant(case, models[-1], watch))
    at = models[-1]
    if len(at.added) > MOST_EFFECTS:
        fewer = min((_without(case, at, a, against=near(at.fit.cost)) for a in at.added), key=penalised_bic)
        if penalised_bic(fewer) < penalised_bic(at) and _may_follow(fewer, at):
            models.append(fewer)
    if explained(models[-1]) and len(models[-1].added) > 1:
        models += _exchanged(case, models[-1], usable, watch)
    return models


def lean(case: Case, at: FittedModel) -> FittedModel:
    """The model without an effect that is idle beside the others: chosen beside a poor fit of another, which then found its
    place."""
    for a in at.added if len(at.added) > 1 else ():
        price = EVIDENCE + np.log(count(at.fit.residuals)) * sum(searched(a.effect, a.form))
        fewer = _without(case, at, a) if _needed(at, a) < price else None
        if fewer is not None and penalised_bic(fewer) <= penalised_bic(at) and _may_follow(fewer, at):
            return fewer
    return at


def _needed(s: FittedModel, a: Added) -> float:
    """By how much chi-square would rise without an effect, to second order (Wald's test)."""
    of_effect, at = np.zeros(len(s.fit.free), bool), BODY_SIZE
    for module in s.fit.state.model.modules:
        for i, q in enumerate(module.PARAMETERS):
            of_effect[at + i] = module is a.effect and q.kind == "number"
        at += len(module.PARAMETERS)
    values = np.concatenate([np.zeros(BODY_SIZE), *s.fit.state.model.values])[s.fit.free]
    of_effect = of_effect[s.fit.free]
    H, v = s.fit.unit, (values * s.fit.scale)[of_effect]
    across = H[np.ix_(of_effect, ~of_effect)]
    remaining_information = (
        H[np.ix_(of_effect, of_effect)]
        - across @ np.linalg.pinv(H[np.ix_(~of_effect, ~of_effect)], hermitian=True) @ across.T
    )
    return float(v @ remaining_information @ v)


def _grown(case: Case, at: FittedModel, usable: list[ModuleType], watch: Watch) -> FittedModel | None:
    """The next model with one effect more, or with another: mass that a contradicted inertia asks for comes first."""
    mass = with_mass(case, at, usable) if len(at.added) <= MOST_EFFECTS else None
    return mass or _step(case, at, usable, watch)


def _step(case: Case, at: FittedModel, usable: list[ModuleType], watch: Watch) -> FittedModel | None:
    """The model with another effect, or with that in place of one of its own; None where neither is worth it."""
    what = f"beside {' + '.join(at.names)}"
    larger = fit_candidates(case, at, _rest(at, usable), FITS_OF_A_PAIR, watch, what, pays=True, against=at.fit.cost)
    if not larger or not penalised_bic(larger[0]) < penalised_bic(at):
        return None
    fewer = [_without(case, larger[0], a, against=near(at.fit.cost)) for a in at.added]
    options = fewer if len(at.added) >= MOST_EFFECTS else [larger[0], *fewer]
    better = [s for s in options if _may_follow(s, at) and penalised_bic(s) < penalised_bic(at)]
    return min(better, key=penalised_bic) if better else None


def _best_rate_constant(case: Case, at: FittedModel, watch: Watch) -> FittedModel:
    """The model, or one with the pace of an effect sought anew: from slow to fast the valley of the misfit is so long and
    bent that a search begun beside a poor fit of another effect rests far from its lowest place."""
    for a in at.added:
        if has_pace(a.effect):
            rest = _without(case, at, a, most=0)
            tried = fit_candidates(case, rest, [a.effect], 1, watch, f"pace of {a.name}", against=at.fit.cost)
            at = min([at, *(s for s in tried if _may_follow(s, at))], key=lambda s: s.bic)
    return at


def _exchanged(case: Case, at: FittedModel, usable: list[ModuleType], watch: Watch) -> list[FittedModel]:
    """Models with another effect in place of one, sought from the motion that both found together, best first."""
    out: list[FittedModel] = []
    for a in at.added:
        rest = _without(case, at, a, most=0)
        what = f"in place of {a.name}"
        out += fit_candidates(case, rest, _rest(at, usable), EXCHANGES, watch, what, against=at.fit.cost)
    return sorted((s for s in out if _may_follow(s, at)), key=lambda s: s.bic)


def _may_follow(s: FittedModel, at: FittedModel) -> bool:
    return not s.implausible and not s.held > at.held + WORSE


def _rest(at: FittedModel, usable: list[ModuleType]) -> list[ModuleType]:
    """Effects that a score test can add: not what only a contradicted inertia speaks for."""
    return [m for m in usable if m.NAME not in at.names and m.NAME != DENSITY]


def _simpler(case: Case, s: FittedModel, a: Added) -> FittedModel:
    """The model with one effect in its simplest form: the longer was wanted while another effect was not there."""
    added = tuple(replace(b, form=0) if b is a else b for b in s.added)
    kept = [
        v if q.form == 0 else 0.0 for q, v in zip(a.effect.PARAMETERS, s.fit.state.model.value(a.name), strict=True)
    ]
    return refit(case, with_effects(s.fit.state, added, {a.name: np.array(kept)}), added)


def _without(
    case: Case, s: FittedModel, idle: Added, most: int = MOST_ITERATIONS, against: float = np.inf
) -> FittedModel:
    added = tuple(a for a in s.added if a is not idle)
    return refit(case, with_effects(s.fit.state, added, {}), added, most, against=against)
