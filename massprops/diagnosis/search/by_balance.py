"""Effects as the balance of momentum finds them in the attitudes that tracks show: where fits to the pixels begin.

Aligned features give an attitude at each epoch that knows no law of motion. A free body, every effect and every pair are
solved for along these (`diagnosis.selection`), and the likeliest begin a fit to the pixels, which has the last word. Where
the attitudes are a free body's, what the pixels hold beyond it is the sensors' or the path's, and nothing begins here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.document import parameters
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import Added, Scored, near, refit, with_effects
from massprops.diagnosis.selection import select
from massprops.effects import effects, forms
from massprops.errors import NotPossible
from massprops.model.state import BatchState

FITTED = 3
"""Of what the balance tried, the likeliest that are fitted to the pixels."""
Watch = Callable[[str, int, int], None]


def fits_by_balance(case: Case, usable: list[ModuleType], watch: Watch, against: float) -> list[Scored]:
    """Fits to the pixels of what the balance of momentum likes best, the best first; none where it likes nothing.

    Args:
        usable: effects that may be named; against: cost of a fit that these are to come near.
    """
    found = []
    for k, (added, start) in enumerate(begun_by_balance(case, usable, watch)):
        watch(f"from the balance of momentum: {' + '.join(a.name for a in added)}", k, FITTED)
        found.append(refit(case, start, added, against=near(min([against, *(s.fit.cost for s in found)]))))
    return sorted(found, key=lambda s: s.bic)


def begun_by_balance(
    case: Case, usable: list[ModuleType], watch: Watch = lambda what, done, total: None
) -> list[tuple[tuple[Added, ...], BatchState]]:
    """Effects in their forms, with the states that the balance of momentum finds: the likeliest first."""
    if case.shown is None:
        return []
    try:
        found = select(record_of_attitudes(case.shown, case.problem.environment), watch)
    except NotPossible:  # too few attitudes, or too far apart
        return []
    names = {m.NAME for m in usable}
    fits = sorted((c.alone for c in found.tried if set(c.alone.names) <= names), key=lambda f: -f.evidence)
    better = [f for f in fits if f.evidence > found.base.evidence]
    return [(_added(f), _state(case, f)) for f in better[:FITTED]]


def _added(fit: HypothesisFit) -> tuple[Added, ...]:
    """In the simplest form, but for a wheel of any history."""
    every = effects()
    last = {"internal-rotor": forms(every["internal-rotor"]) - 1} if fit.hypothesis.wheel else {}
    return tuple(Added(every[n], last.get(n, 0)) for n in fit.names)


def _state(case: Case, fit: HypothesisFit) -> BatchState:
    """The balance's motion and effects, and the features and the path of the first guess."""
    begun = replace(
        case.first.state, q0=fit.record.path.q[0], w0=fit.rate[0], inertia=3.0 * fit.inertia / np.trace(fit.inertia)
    )
    values = {}
    for name in fit.names:
        value = parameters(fit, name)[0]
        values[name] = np.array([value[q.name] for q in effects()[name].PARAMETERS])
    return with_effects(begun, _added(fit), values)
