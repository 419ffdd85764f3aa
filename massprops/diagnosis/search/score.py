"""Score tests: what an effect would be worth beside a model, from gradient and curvature, without a fit.

Effects that change nothing at the values where they are tried leave the model's motion as it is, so many of them stand
in one linearisation, and the equations of each are a part of those of all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import Added, FittedModel
from massprops.effects import changes_motion, searched
from massprops.estimators.batch.solve import reduced_equations, robust
from massprops.model import Model
from massprops.model.linearise import linearise, predict, residuals
from massprops.model.state import BODY_SIZE

MOST_TOGETHER = 160
"""Parameters of the effects in one linearisation."""
HELD = ("time", "pace")
"""Kinds of parameters that a score test keeps as they are."""


@dataclass(frozen=True)
class ScoreTest:
    """A candidate: gain, by how much chi-square would fall, to second order; values: its parameters after that step."""

    added: Added
    gain: float
    start: np.ndarray
    values: np.ndarray


def score_tests(
    case: Case, upon: FittedModel, candidates: list[tuple[Added, np.ndarray]], instead_of: str = ""
) -> list[ScoreTest]:
    """The gain of each candidate, an effect with parameters to begin with, beside a fitted model; in the same order.

    Args:
        instead_of: name of an effect of the model that goes to zero as the candidate comes.
    """
    with np.errstate(all="ignore"):
        at = predict(case.problem, upon.fit.state, case.environment)
        residual = residuals(case.problem, case.scored, at)
        weights = robust(residual, case.scored)[0]
        cost = float(np.sum(weights * residual.squares))
        groups: list[list[int]] = [[]]
        for i, (added, values) in enumerate(candidates):
            if not _idle(added, values):
                groups.append([i])
            elif sum(len(candidates[k][1]) for k in groups[0]) + len(values) <= MOST_TOGETHER:
                groups[0].append(i)
            else:
                groups.append(groups[0])
                groups[0] = [i]
        out: dict[int, ScoreTest] = {}
        for group in groups:
            together = [candidates[i] for i in group]
            out.update(zip(group, _scored_together(case, upon, together, weights, cost, instead_of), strict=True))
    return [out[i] for i in range(len(candidates))]


def _idle(added: Added, values: np.ndarray) -> bool:
    """Whether the effect changes nothing at these values."""
    numbers = [v for q, v in zip(added.effect.PARAMETERS, values, strict=True) if q.kind == "number"]
    return not np.any(numbers) and not getattr(added.effect, "STATES", 0)


def _scored_together(
    case: Case,
    upon: FittedModel,
    candidates: list[tuple[Added, np.ndarray]],
    weights: np.ndarray,
    cost: float,
    instead_of: str,
) -> list[ScoreTest]:
    if not candidates:
        return []
    old = upon.fit.state.model
    form = {a.name: a.form for a in upon.added}
    entries = [
        (m, v, searched(m, form[m.NAME]), -2 if instead_of == m.NAME else -1)
        for m, v in zip(old.modules, old.values, strict=True)
    ]
    for k, (added, values) in enumerate(candidates):
        moves = [
            yes and q.kind not in HELD
            for q, yes in zip(added.effect.PARAMETERS, searched(added.effect, added.form), strict=True)
        ]
        entries.append((added.effect, values, moves, k))
    entries.sort(key=lambda e: not changes_motion(e[0]))
    timed = [[q.kind == "time" for q in m.PARAMETERS] for m, *_ in entries]
    owner = np.concatenate([np.full(BODY_SIZE, -1), *(np.full(len(v), k) for _, v, _, k in entries)])
    free = np.concatenate([case.first.free, *(m for *_, m, _ in entries)]).astype(bool)
    free[BODY_SIZE:] &= ~np.concatenate(timed)
    trial = replace(upon.fit.state, model=Model(tuple(m for m, *_ in entries), tuple(v for _, v, *_ in entries)))
    at = predict(case.problem, trial, case.environment)
    linear = linearise(case.problem, case.scored, at, case.environment)
    reduced = reduced_equations(linear, case.scored, weights, free, trial, case.inertia_prior)
    worse = float(np.sum(weights * linear.residuals.squares)) - cost
    share = case.fitted.count / max(1, case.scored.count)
    owner = owner[free]
    base, _ = _solved(reduced.H, reduced.full, reduced.b, owner < 0)
    # an effect that goes takes a given step: what that does to chi-square, and to the gradient of the others
    goes = owner == -2
    step = -np.concatenate([np.zeros(BODY_SIZE), *(v for _, v, *_ in entries)])[free][goes]
    b = reduced.b - reduced.H[:, goes] @ step
    worse -= float((reduced.b[goes] + b[goes]) @ step)
    out = []
    for k, (added, values) in enumerate(candidates):
        gain, step = _solved(reduced.H, reduced.full, b, (owner == -1) | (owner == k))
        moved = np.array(values, float)
        free_values = [q for q, yes in zip(range(len(values)), _free_of(entries, k), strict=True) if yes]
        moved[free_values] += step[owner[(owner == -1) | (owner == k)] == k]
        gain = (gain - base - worse) * share
        good = np.isfinite(gain) and np.isfinite(moved).all()
        out.append(ScoreTest(added, float(gain) if good else 0.0, np.array(values, float), moved if good else values))
    return out


def _free_of(entries: list[Any], k: int) -> list[bool]:
    return next(moves for _, _, moves, owner in entries if owner == k)


def _solved(H: np.ndarray, full: np.ndarray, b: np.ndarray, own: np.ndarray) -> tuple[float, np.ndarray]:
    """Fall of chi-square and the step in a part of the parameters."""
    H, b = H[np.ix_(own, own)], b[own]
    scale = np.sqrt(np.maximum(np.diag(full)[own], 1e-300))
    H, b = H / scale[:, None] / scale, b / scale
    try:
        step = np.linalg.solve(H + 1e-9 * np.eye(len(H)), b)
    except np.linalg.LinAlgError:
        return 0.0, np.zeros(len(b))
    return float(b @ step), step / scale
