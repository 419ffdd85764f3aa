"""Two effects at once: beside each of the most likely single ones, the second that the balance asks for."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.effect_columns import Term, scan, variants
from massprops.diagnosis.effect_search import admissible, again, moved_to_best
from massprops.diagnosis.hypothesis_fit import HypothesisFit, term_gain
from massprops.diagnosis.record import Record

FIRSTS = 3
"""Single effects, the most likely, beside which a second is looked for: one that acts with another may not be first alone."""
SECONDS = 6
"""Effects fitted beside each of them, those with the largest gain to first order. Beside a wheel that a torque bends the torque
stood fifth in one Basilisk record and first in another."""
MOVED = 2
"""Pairs, the most likely, whose times and directions are moved to their best."""


def pairs(
    record: Record, singles: list[tuple[HypothesisFit, HypothesisFit | None]], usable: list[ModuleType]
) -> list[HypothesisFit]:
    """Fits of two effects, the most likely first.

    Args:
        singles: one effect by itself, the most likely first, and beside an unknown torque or None: by itself it is bent by
            what the other does, beside an unknown torque it is not. The second is looked for beside either, and the pair
            begins there. usable: effects that may act beside them.
    """
    gap = float(np.median(np.diff(record.times)))
    found: dict[frozenset[str], HypothesisFit] = {}
    for start in (fit for single in singles[:FIRSTS] for fit in single if fit is not None):
        for term in seconds(start, usable, gap)[:SECONDS]:
            both = replace(start.hypothesis, terms=(*start.hypothesis.terms, term))
            fit = admissible(record, both, again(start), latent=False)
            names = frozenset(both.names)
            if fit is not None and (names not in found or fit.evidence > found[names].evidence):
                found[names] = fit
    ranked = sorted(found.values(), key=lambda f: -f.evidence)
    moved = [_both_moved(f, gap) for f in ranked[:MOVED]]
    return sorted([*moved, *ranked[MOVED:]], key=lambda f: -f.evidence)


def seconds(first: HypothesisFit, usable: list[ModuleType], gap: float) -> list[Term]:
    """Each other effect at the scanned value that gains most beside a fit, the largest gain first."""
    record = first.record
    rates = record.path.w[record.rows.at]
    best = []
    for effect in usable:
        if effect.NAME in first.names:
            continue
        scanned = [(term_gain(first, t), t) for t in scan(effect, record.times, rates)]
        gain, term = max(scanned, key=lambda s: s[0])
        more = [(term_gain(first, t), t) for t in variants(term, gap)]
        best.append(max([(gain, term), *more], key=lambda s: s[0]))
    return [term for _, term in sorted(best, key=lambda s: -s[0])]


def _both_moved(fit: HypothesisFit, gap: float) -> HypothesisFit:
    for which in range(len(fit.hypothesis.terms)):
        fit = moved_to_best(fit, gap, which)
    return fit
