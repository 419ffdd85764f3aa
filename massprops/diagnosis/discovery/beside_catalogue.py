"""A law against what the catalogue names in the same record: which is likelier, in one log evidence.

Both are fitted to the same rows. Both pay for what they were looked for among: a law for the library (`Regression.prices`), an effect
for the values it was looked for at and for the hypotheses that it is the likeliest of.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from massprops.diagnosis.candidate import Candidate, Selection, paid
from massprops.diagnosis.discovery.law import Against, Law
from massprops.diagnosis.effect_columns import has_known_rate
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.selection import usable_effects
from massprops.diagnosis.wheel_of_any_history import wheel_of_any_history
from massprops.errors import NotPossible


def against_selection(law: Law, selection: Selection) -> Against | None:
    """A law against what a selection names; None where that is nothing, or was fitted to other rows."""
    fits = [c.best for c in selection.named if len(c.best.y) == len(law.base.y)]
    return _against(law, fits, len(selection.tried))


def against_name(law: Law, name: str) -> Against | None:
    """A law against the one effect that a search over starts names; None where the balance does not hold it."""
    record, fits = law.base.record, []
    usable = usable_effects(record)[0]
    for effect in (e for e in usable if name == e.NAME):
        fits.append(best_fit(record, effect, law.base))
        if name == "internal-rotor" and not has_known_rate(effect):
            with suppress(NotPossible):
                fits.append(wheel_of_any_history(record).alone)
    return _against(law, [f for f in fits if f is not None], len(usable))


def _against(law: Law, fits: list[HypothesisFit], tried: int) -> Against | None:
    if not fits:
        return None
    best = max(fits, key=paid)
    law_evidence = Candidate(alone=law.alone, with_latent=law.with_latent).evidence - law.price
    return Against(names=best.names, ahead=float(law_evidence - (paid(best) - np.log(max(tried, 1)))))
