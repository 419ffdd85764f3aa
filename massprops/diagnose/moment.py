"""Search over the moment of an effect that moves the tracks at once.

Where feature points or the attitude jump, the misfit is not continuous as the moment passes an epoch: a search by
slopes rests in whichever gap between epochs it comes to. Gaps farther off are tried one by one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprops.diagnose.case import Case
from massprops.diagnose.refit import Scored, refit
from massprops.model import Model

WIDEST = 16
"""Epochs by which the moment is moved at first; halved whenever neither side is better."""
TRIAL = 5
"""Iterations after which two moments are compared."""
MOST_TRIALS = 24


def moves_at_once(effect: object) -> bool:
    """Whether tracks jump at the effect's moment."""
    return hasattr(effect, "shift") or hasattr(effect, "swing")


def best_moment(case: Case, s: Scored, most: int = 40) -> Scored:
    """The fit `s`, or one with the moment of its last effect in another gap between epochs if that explains more."""
    effect = s.added[-1].effect
    places = [i for i, q in enumerate(effect.PARAMETERS) if q.kind == "time"]
    if not places or not moves_at_once(effect):
        return s
    times = case.problem.times
    middles = 0.5 * (times[1:] + times[:-1])
    best, away, trials, tried = s, WIDEST, 0, set()
    while away >= 1 and trials < MOST_TRIALS:
        model = best.fit.state.model
        now = int(np.clip(np.searchsorted(times, model.value(effect.NAME)[places[0]]) - 1, 0, len(middles) - 1))
        found = None
        for k in (now - away, now + away):
            if not 0 <= k < len(middles) or k in tried:
                continue
            tried.add(k)
            trials += 1
            values = list(model.values)
            at = model.names.index(effect.NAME)
            values[at] = values[at].copy()
            values[at][places[0]] = middles[k]
            start = replace(best.fit.state, model=Model(model.modules, tuple(values), model.inertia))
            trial = refit(case, start, s.added, most=TRIAL)
            if trial.bic < min(best.bic, found.bic if found else np.inf):
                found = trial
        if found is None:
            away //= 2
        else:
            best = found
    return best if best is s else refit(case, best.fit.state, s.added, most)
