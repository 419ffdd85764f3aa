"""Search over the moment of an effect that moves the tracks at once.

Where feature points or the attitude jump, the misfit is not continuous as the moment passes an epoch: a search by
slopes rests in whichever gap between epochs it comes to. Gaps farther off are tried one by one.
"""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnose.case import Case
from massprops.diagnose.refit import Added, Scored, refit
from massprops.effects import searched
from massprops.estimators.batch.state import BatchState
from massprops.model import Model

WIDEST = 0.2
"""Share of the epochs by which the moment is moved at first; halved whenever neither side is better."""
TRIAL = 5
"""Iterations after which two moments are compared."""
MOST_TRIALS = 16
EVIDENCE = 10.0
"""Difference of BIC that decides (Kass and Raftery 1995: very strong)."""


def moves_at_once(effect: ModuleType) -> bool:
    """Whether tracks jump at the effect's moment."""
    return hasattr(effect, "shift") or hasattr(effect, "swing")


def between_epochs(case: Case, state: BatchState, added: Added) -> BatchState:
    """The state with the moment of an effect that holds it halfway between its two epochs."""
    effect = added.effect
    place = _place(effect)
    if place is None or searched(effect, added.form)[place]:
        return state
    middles, now = _gap(case, state, effect, place)
    return _at(state, effect, place, float(middles[now]))


def best_moment(case: Case, s: Scored, widest: float = WIDEST, most: int = 40) -> Scored:
    """The fit `s`, or one with the moment of its last effect in another gap between epochs if that explains more.

    Args:
        widest: share of the epochs by which the moment is moved at first.
    """
    effect = s.added[-1].effect
    place = _place(effect)
    if place is None or not moves_at_once(effect):
        return s
    away = max(1, round(widest * len(case.problem.times)))
    best, trials, tried = s, 0, set()
    while away >= 1 and trials < MOST_TRIALS:
        middles, now = _gap(case, best.fit.state, effect, place)
        found = None
        for k in (now - away, now + away):
            if not 0 <= k < len(middles) or k in tried:
                continue
            tried.add(k)
            trials += 1
            start = _at(best.fit.state, effect, place, float(middles[k]))
            trial = refit(case, start, s.added, most=TRIAL)
            if trial.bic < min(best.bic - EVIDENCE, found.bic if found else np.inf):
                found = trial
        if found is None:
            away //= 2
        else:
            best = found
    return best if best is s else refit(case, best.fit.state, s.added, most)


def _place(effect: ModuleType) -> int | None:
    places = [i for i, q in enumerate(effect.PARAMETERS) if q.kind == "time"]
    return places[0] if places else None


def _gap(case: Case, state: BatchState, effect: ModuleType, place: int) -> tuple[np.ndarray, int]:
    """Middles of all gaps between epochs, and which of them the moment lies in."""
    times = case.problem.times
    now = np.searchsorted(times, state.model.value(effect.NAME)[place]) - 1
    return 0.5 * (times[1:] + times[:-1]), int(np.clip(now, 0, len(times) - 2))


def _at(state: BatchState, effect: ModuleType, place: int, moment: float) -> BatchState:
    model = state.model
    values = [v.copy() for v in model.values]
    values[model.names.index(effect.NAME)][place] = moment
    return replace(state, model=Model(model.modules, tuple(values), model.inertia))
