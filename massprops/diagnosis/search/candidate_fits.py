"""Fits of the promising candidates together with a model, in the order of their score tests."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np

from massprops.diagnosis.search.acceptance import explained
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.event_time import EVIDENCE
from massprops.diagnosis.search.refit import Added, FittedModel, near, refit, start_values, with_effects
from massprops.diagnosis.search.residual_statistics import count
from massprops.diagnosis.search.score import ScoreTest, score_tests
from massprops.effects import has_pace, searched

WORTH_A_FIT = 0.1
"""Share of the best score gain that a candidate needs to be fitted."""
FEWEST_FITS = 5
STARTS = 2
"""Starts of one effect that are fitted."""
FITS_OF_A_PAIR = 3
Watch = Callable[[str, int, int], None]


def fit_candidates(
    case: Case,
    upon: FittedModel,
    modules: list[ModuleType],
    fewest: int,
    watch: Watch,
    what: str,
    pays: bool = False,
    against: float = np.inf,
) -> list[FittedModel]:
    """Score tests of all candidates added to a model, then fits of the promising ones, best first.

    Args:
        fewest: effects that are fitted in any case; what: told to `watch`.
        pays: only those whose score is worth their parameters are fitted.
        against: cost of a fit that these are to come near.
    """
    watch(f"{what}: scores", 0, 1)
    candidates = [(Added(m), v) for m in modules for v in start_values(case, m)]
    tests = sorted(score_tests(case, upon, candidates), key=lambda t: -t.gain)
    by: dict[str, list[ScoreTest]] = {}
    for t in tests:
        by.setdefault(t.added.name, []).append(t)
    top = tests[0].gain if tests else 0.0
    chosen = [
        g for i, g in enumerate(by.values()) if i < fewest or g[0].gain > WORTH_A_FIT * top and fewest >= FEWEST_FITS
    ]
    if pays:
        price = np.log(count(upon.fit.residuals))
        chosen = [g for g in chosen if g[0].gain > EVIDENCE + price * sum(searched(g[0].added.effect))]
    out: list[FittedModel] = []
    for k, starts in enumerate(chosen):
        watch(f"{what}: fit of {starts[0].added.name}", k, len(chosen))
        least = min((s.fit.cost for s in out), default=against)
        most = len(starts) if has_pace(starts[0].added.effect) and (k == 0 or not upon.added) else STARTS
        out.append(_best_fit(case, upon, starts[:most], near(least)))
    return sorted(out, key=lambda s: s.bic)


def _best_fit(case: Case, upon: FittedModel, starts: list[ScoreTest], against: float) -> FittedModel:
    added = (*upon.added, starts[0].added)
    best: FittedModel | None = None
    for test in starts:
        begin = with_effects(upon.fit.state, added, {test.added.name: _begun(test)})
        tried = refit(case, begin, added, against=against)
        if best is None or tried.bic < best.bic:
            best = tried
            against = min(against, near(tried.fit.cost))
        if explained(best) and not has_pace(test.added.effect):
            break
    assert best is not None
    return best


def _begun(test: ScoreTest) -> np.ndarray:
    """Parameters to begin with: an effect whose pace means nothing without a size begins with the size that the score
    test gives it."""
    if not has_pace(test.added.effect):
        return test.start
    values = np.array(test.values)
    for i, q in enumerate(test.added.effect.PARAMETERS):
        if q.kind == "number":
            values[i] = np.clip(values[i], 0.2 * q.size, 6.0 * q.size)
    return values
