"""Effects as the balance of momentum finds them in the attitudes that tracks show: where fits to the pixels begin.

Aligned features give an attitude at each epoch that knows no law of motion. A free body, every effect and every pair are
solved for along these (`diagnosis.selection`), and the likeliest begin a fit to the pixels, which has the last word. Where
the attitudes are a free body's, what the pixels hold beyond it is the sensors' or the path's, and nothing begins here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.candidate import Selection, within_noise
from massprops.diagnosis.document import parameters
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.search.assumed import with_mass
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import Added, FittedModel, near, refit, with_effects
from massprops.diagnosis.selection import select
from massprops.effects import effects, forms
from massprops.errors import NotPossible
from massprops.model.state import BatchState

FITTED = 3
"""Of what the balance may name, the likeliest that are fitted to the pixels."""
Watch = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class ByBalance:
    """What the balance of momentum gave.

    Attributes:
        fits: to the pixels, of what it likes best, the best first; forced: whether the attitudes are those of no free body,
            so that something acts on the motion; named: whether the catalogue explains the attitudes.
    """

    fits: tuple[FittedModel, ...] = ()
    forced: bool = False
    named: bool = False


def fits_by_balance(case: Case, usable: list[ModuleType], watch: Watch, against: float) -> ByBalance:
    """Fits to the pixels of what the balance of momentum likes best; none where it likes nothing.

    Args:
        usable: effects that may be named; against: cost of a fit that these are to come near.
    """
    selected = _selected(case, watch)
    if selected is None:
        return ByBalance()
    fitted_models: list[FittedModel] = []
    for k, (added, start) in enumerate(_begun(case, selected, usable)):
        watch(f"from the balance of momentum: {' + '.join(a.name for a in added)}", k, FITTED)
        least = near(min([against, *(s.fit.cost for s in fitted_models)]))
        fitted_models.append(_with_its_mass(case, refit(case, start, added, against=least), usable))
    return ByBalance(
        fits=tuple(sorted(fitted_models, key=lambda s: s.bic)),
        forced=not within_noise(selected.base),
        named=bool(selected.named),
    )


def _with_its_mass(case: Case, s: FittedModel, usable: list[ModuleType]) -> FittedModel:
    """The fit of one effect, beside uneven density where it leaves the inertia that is assumed: the balance assumes none."""
    return (with_mass(case, s, usable) or s) if len(s.added) == 1 else s


def _selected(case: Case, watch: Watch) -> Selection | None:
    """What the balance of momentum says of the attitudes; None where they are too few or too far apart."""
    if case.shown is None:
        return None
    if not case.balance:
        try:
            given, first = case.problem.environment, case.problem.first_ns
            case.balance.append(select(record_of_attitudes(case.shown, given, first_ns=first), watch))
        except NotPossible:
            case.balance.append(None)
    return case.balance[0]


def _begun(case: Case, selection: Selection, usable: list[ModuleType]) -> list[tuple[tuple[Added, ...], BatchState]]:
    # an effect that an unknown torque beats may still fit the pixels, where no such torque is its rival
    names = {m.NAME for m in usable}
    fits = [c.alone for c in selection.named if set(c.alone.names) <= names]
    return [(_added(f), _state(case, f)) for f in fits[:FITTED]]


def _added(fit: HypothesisFit) -> tuple[Added, ...]:
    """In the simplest form, but for a wheel of any history."""
    every = effects()
    last = {"internal-rotor": forms(every["internal-rotor"]) - 1} if fit.hypothesis.wheel else {}
    return tuple(Added(every[n], last.get(n, 0), _given(fit, n)) for n in fit.names)


def _given(fit: HypothesisFit, name: str) -> float | None:
    """How many parameters of an effect the attitudes determine, where its prior says more of them than each one's size: a fit
    to the pixels has no such prior, so they stay. None where it finds them itself."""
    if not hasattr(effects()[name], "momentum_prior"):
        return None
    post = fit.posterior
    return float(np.sum(1.0 - np.diag(post.covariance[name]) / post.sd[name] ** 2))


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
