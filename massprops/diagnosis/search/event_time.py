"""Search over the moment of an effect that moves the tracks at once.

Where feature points or the attitude jump, the misfit is not continuous as the moment passes an epoch: a search by
slopes rests in whichever gap between epochs it comes to. But the motion is nearly linear in the size of an effect that
begins at a given moment: a score test shows what the effect would be worth in another gap instead.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import MOST_ITERATIONS, Added, FittedModel, near, refit, with_value
from massprops.diagnosis.search.residual_statistics import count
from massprops.diagnosis.search.score import score_tests
from massprops.effects import places_of, searched
from massprops.model.state import BatchState

NEAR = (1, 2, 3, 4, 6, 8, 11)
"""Gaps away from the moment that is that are looked at, on both sides."""
APART = 16
"""Gaps between those that are looked at first over the whole record."""
EVIDENCE = 10.0
"""Difference of BIC that decides (Kass and Raftery 1995: very strong)."""
OF_THE_REST = 0.02
"""Share of what a model leaves over that another moment must explain."""


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
    return with_value(state, effect, place, float(middles[now]))


def best_event_time(case: Case, s: FittedModel, far: bool = True) -> FittedModel:
    """The fit `s`, or one with the moments of its effects in other gaps between epochs if that explains more.

    Args:
        far: looks over the whole record, not only near.
    """
    for added in s.added:
        place = _place(added.effect)
        while place is not None and moves_at_once(added.effect):
            moment = _promising(case, s, added, place, far)
            if moment is None:
                break
            # sizes that suit another moment would lead a search by slopes away from this one
            there = with_value(s.fit.state, added.effect, place, moment)
            least = near(s.fit.cost)
            still = refit(case, there, s.added, MOST_ITERATIONS, least, hold="time")
            moved = refit(case, still.fit.state, s.added, MOST_ITERATIONS, least)
            if not moved.bic < s.bic - _decides(s):
                break
            s = moved
    return s


def _promising(case: Case, s: FittedModel, added: Added, place: int, far: bool) -> float | None:
    """The middle of the gap to which it would be worth most to move an effect, coarse to fine; None where nothing is."""
    effect = added.effect
    middles, now = _gap(case, s.fit.state, effect, place)
    last = len(middles) - 1
    gains, best = {now: 0.0}, now
    away = np.array([*NEAR, *(range(APART, last + 1, APART) if far else ())])
    look = now + np.concatenate([-away, away])
    while True:
        ks = [int(k) for k in np.unique(look) if 0 <= k <= last and int(k) not in gains]
        if not ks:
            return float(middles[best])
        tests = score_tests(case, s, [(added, _nothing(effect, place, float(middles[k]))) for k in ks], effect.NAME)
        gains.update((k, t.gain) for k, t in zip(ks, tests, strict=True))
        best = max(gains, key=lambda k: gains[k])
        if gains[best] < _decides(s):
            return None
        tried = sorted(gains)
        i = tried.index(best)
        look = np.linspace(tried[max(i - 1, 0)], tried[min(i + 1, len(tried) - 1)], 2 * len(NEAR) + 1).round()


def _decides(s: FittedModel) -> float:
    """Difference of BIC that decides between moments: where much is left over anyway, a share of that."""
    return max(EVIDENCE, OF_THE_REST * count(s.fit.residuals) * float(np.log(max(1.0, s.fitted**2))))


def _nothing(effect: ModuleType, place: int, moment: float) -> np.ndarray:
    values = np.zeros(len(effect.PARAMETERS))
    values[place] = moment
    return values


def _place(effect: ModuleType) -> int | None:
    places = places_of(effect, "time")
    return places[0] if places else None


def _gap(case: Case, state: BatchState, effect: ModuleType, place: int) -> tuple[np.ndarray, int]:
    """Middles of all gaps between epochs, and which of them the moment lies in."""
    times = case.problem.times
    now = np.searchsorted(times, state.model.value(effect.NAME)[place]) - 1
    return 0.5 * (times[1:] + times[:-1]), int(np.clip(now, 0, len(times) - 2))
