"""A model with certain effects, fitted to the fitted part of the data and tried on the part held out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.residual_statistics import count, mean_square, whiteness
from massprops.effects import effects, searched
from massprops.estimators.batch.solve import Fit, Search, covariance_of, fit, prior_residuals
from massprops.model import Model
from massprops.model.linearise import residuals
from massprops.model.state import BODY_SIZE, BatchState

MOST_ITERATIONS = 25
IDLE = 0.3
"""Fall of BIC per iteration below which a search is over; ten times that decides nothing."""
POLISH = 0.03
"""Fall of BIC per iteration at which the search of the model chosen ends."""
IMPLAUSIBLE = 3.0
"""Sigmas beyond a parameter's plausible limits at which an effect is ruled out."""


@dataclass(frozen=True)
class Added:
    """An effect in a form: 0 the simplest.

    Attributes:
        given: None where a fit finds its parameters; where they stay as the balance of momentum found them under a prior,
            how many independent ones that was (MacKay's number of well-determined parameters).
    """

    effect: ModuleType
    form: int = 0
    given: float | None = None

    @property
    def name(self) -> str:
        return str(self.effect.NAME)


@dataclass(frozen=True)
class FittedModel:
    """A fitted model.

    Attributes:
        added: effects beyond the base model; fit: where the search ended.
        fitted, held: root-mean-square residual over the noise on the fitted data and on that held out.
        white: score of correlation between neighbouring residuals; bic: lower is better.
        sigma: by effect, 1-sigma of its parameters; implausible: why it cannot be, or empty.
    """

    added: tuple[Added, ...]
    fit: Fit
    fitted: float
    held: float
    white: float
    bic: float
    sigma: dict[str, np.ndarray]
    implausible: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(a.name for a in self.added)


def with_effects(state: BatchState, added: tuple[Added, ...], values: dict[str, np.ndarray]) -> BatchState:
    """The state under a model with these effects; values by name, others as they are in the state's model or zero."""
    names = {a.name for a in added}
    # in the order of the catalogue, as `model.yaml` is read: a bent picture that grows is not a grown one that is bent
    modules = [module for name, module in effects().items() if name in names]
    old = state.model
    out = []
    for module in modules:
        if module.NAME in values:
            out.append(np.asarray(values[module.NAME], float))
        elif module.NAME in old.names:
            out.append(old.value(module.NAME))
        else:
            out.append(np.zeros(len(module.PARAMETERS)))
    return replace(state, model=Model(tuple(modules), tuple(out)))


def with_value(state: BatchState, effect: ModuleType, place: int, value: float) -> BatchState:
    """The state with one of the effects' parameters at a value."""
    values = state.model.value(effect.NAME).copy()
    values[place] = value
    every = zip(state.model.modules, state.model.values, strict=True)
    return replace(state, model=replace(state.model, values=tuple(values if m is effect else v for m, v in every)))


def start_values(case: Case, effect: ModuleType) -> list[np.ndarray]:
    """Parameter vectors (k,) to begin a search with: the effect's own, or zero."""
    offered = effect.starts(case.span, case.speed) if hasattr(effect, "starts") else [np.zeros(len(effect.PARAMETERS))]
    out = []
    for values in offered:
        values = np.array(values, float)
        for i, q in enumerate(effect.PARAMETERS):
            if q.kind == "span":
                values[i] = case.span
        out.append(values)
    return out


def free_of(case: Case, state: BatchState, added: tuple[Added, ...], hold: str = "") -> np.ndarray:
    """(size,) which parameters may move; `hold`: kind of the effects' parameters that keep their values."""
    by_name = {a.name: a for a in added}
    mask = list(case.first.free)
    for module in state.model.modules:
        not_given = by_name[module.NAME].given is None
        each = zip(module.PARAMETERS, searched(module, by_name[module.NAME].form), strict=True)
        mask += [not_given and yes and q.kind != hold for q, yes in each]
    return np.array(mask)


def near(cost: float) -> float:
    """The cost that a fit must be able to come to if it is to be compared with one of this cost."""
    return 1.02 * cost + 50.0


def refit(
    case: Case,
    start: BatchState,
    added: tuple[Added, ...],
    most: int = MOST_ITERATIONS,
    against: float = np.inf,
    idle: float = IDLE,
    hold: str = "",
) -> FittedModel:
    """Fits a model from a state that has its effects; `against`, `idle` as in `batch.solve.Search`, `hold` as in `free_of`."""
    free = free_of(case, start, added, hold)
    with np.errstate(all="ignore"):
        # wild trial steps overflow; the search turns back from them by itself
        search = Search(most, idle=idle, against=against)
        fitted = fit(case.problem, case.fitted, start, case.environment, free, case.inertia_prior, search)
    return fitted_model(case, fitted, added)


def fitted_model(case: Case, found: Fit, added: tuple[Added, ...]) -> FittedModel:
    """What a fit is worth."""
    r = found.residuals
    n = count(r)
    ms = mean_square(r)
    value, _ = prior_residuals(found.state, case.inertia_prior)
    unit = found.unit
    parameters = int(np.linalg.matrix_rank(unit, tol=1e-10)) if np.isfinite(unit).all() else len(unit)
    spent = parameters + sum(a.given or 0.0 for a in added)
    bic = n * np.log(max(ms, 1e-12) + float(value @ value) / n) + spent * np.log(n)
    held = residuals(case.problem, case.held, found.predicted)
    usable = bool(np.isfinite(found.information).all() and np.isfinite(found.cost))
    covariance = covariance_of(found) if usable else np.full((len(found.free),) * 2, np.inf)
    sigma, at = {}, BODY_SIZE
    implausible = ""
    for module, values in zip(found.state.model.modules, found.state.model.values, strict=True):
        sigmas = np.sqrt(np.diag(covariance))[at : at + len(values)]
        for i, q in enumerate(module.PARAMETERS):
            if q.kind == "time" and not found.free[at + i]:
                # anywhere between two epochs
                sigmas[i] = float(np.median(np.diff(case.problem.times))) / np.sqrt(12.0)
        at += len(values)
        sigma[module.NAME] = sigmas
        implausible = implausible or _implausible(module, values, sigmas, case)
    return FittedModel(
        added=added,
        fit=found,
        fitted=float(np.sqrt(ms)),
        held=float(np.sqrt(mean_square(held))) if case.held.count else float("nan"),
        white=whiteness(r, case.fitted, case.problem.rate_memory),
        bic=float(bic) if usable and np.isfinite(bic) else np.inf,
        sigma=sigma,
        implausible=implausible,
    )


def _implausible(module: ModuleType, values: np.ndarray, sigma: np.ndarray, case: Case) -> str:
    for q, v, s in zip(module.PARAMETERS, values, sigma, strict=True):
        if q.least is not None and v + IMPLAUSIBLE * s < q.least:
            return f"{q.name} {v:.3g} {q.unit} is below the least that is plausible, {q.least:g}"
        if q.limit is not None and abs(v) - IMPLAUSIBLE * s > q.limit:
            return f"{q.name} {v:.3g} {q.unit} is beyond the plausible, {q.limit:g}"
        if q.kind == "time" and not 0 < v < case.span:
            return f"{q.name} {v:.3g} s lies outside the record"
    return ""
