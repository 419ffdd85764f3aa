"""Which values of what is scanned of two effects are worth a fit: those that leave the least momentum, a linear solution each."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from massprops.diagnosis.conserved_start import Start, conserved_by_both, start_of
from massprops.diagnosis.effect_columns import Term, forcing_of, scan, steps, term_of, variants
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.momentum_balance import Forcing
from massprops.diagnosis.record import Record

KEPT = 6
"""Values of what is scanned of a pair, those that leave the least momentum, that are fitted for a few passes."""
FEW = 20
"""Values up to which all are fitted."""
ANCHORED = 3
"""Of more values, those that are fitted too with one of the two effects as it is likeliest by itself: an event shows its moment
whatever acts beside it."""
LOCAL_MINIMA, WINDOW = 8, 7
"""Of more values, those that are fitted because others about them leave more, the local minima deepest below the median of so many."""
LEAST_DIP = 0.02
"""Least depth of a dip, logarithm: a boom beside sunlight is 0.2 deep, beside a firing 1.1 (two bodies moved by MuJoCo)."""
Terms = tuple[Term, ...]


@dataclass(frozen=True, kw_only=True)
class Scanned:
    """An effect at every value that is scanned, with its columns along the path of a record.

    Attributes:
        terms, forcings: one of each for a value; alone: whether the last value is the one that is likeliest by itself.
    """

    terms: list[Term]
    forcings: list[Forcing]
    alone: bool = False

    @property
    def name(self) -> str:
        return self.terms[0].name


def scanned(record: Record, effect: ModuleType, unknown: HypothesisFit, alone: Term | None) -> Scanned:
    """The effect at every value along the path of a record.

    Args:
        unknown: the free body with an unknown torque; alone: the effect as it is likeliest by itself, or None.
    """
    path = record.path
    gap = float(np.median(np.diff(record.times)))
    terms = _moments(scan(effect, record.times, path.w[record.rows.at]), gap)
    apart = alone is not None and len(terms) > 1
    if alone is not None and apart:
        terms = [*terms, alone]
    forcings = [forcing_of(t, path, path.w, unknown.inertia, record.environment_state) for t in terms]
    return Scanned(terms=terms, forcings=forcings, alone=apart)


def _moments(terms: list[Term], gap: float) -> list[Term]:
    """The same, at moments no farther apart than the step by which one is moved to its best: beside another effect a moment that
    is off by more does not show. One with variants has wide ones among them."""
    held = [dict(t.held) for t in terms]
    if len(held) < 2 or "time" not in held[0] or variants(terms[0], gap):
        return terms
    first, last = held[0]["time"], held[-1]["time"]
    count = max(len(terms), 1 + int(np.ceil((last - first) / steps(terms[0], gap)["time"])))
    return [term_of(terms[0].effect, held[0] | {"time": float(t)}) for t in np.linspace(first, last, count)]


def least_left(record: Record, a: Scanned, b: Scanned) -> list[tuple[Terms, Start]]:
    """Values of two effects that are worth a fit, each with the inertia that its linear solution has: those that leave the
    least momentum of all, of those with one effect as it is likeliest by itself, and of those about which others leave more.

    The inertia is one of the unknowns. That of a free body with an unknown torque would be no start: what the torque takes up
    leaves the inertia open.
    """
    squares, sixes = conserved_by_both(record.path, record.rows.at, a.forcings, b.forcings)
    remaining_momentum = np.sqrt(np.maximum(squares, 0.0))
    order = [divmod(int(k), remaining_momentum.shape[1]) for k in np.argsort(remaining_momentum, axis=None)]
    if len(order) > FEW:
        every, order = order, order[:KEPT]
        for side, scanned_effect in enumerate((a, b)):
            if scanned_effect.alone:
                order += [k for k in every if k[side] == len(scanned_effect.terms) - 1][:ANCHORED]
        order += _dips(remaining_momentum[: len(a.terms) - a.alone, : len(b.terms) - b.alone])
    return [((a.terms[i], b.terms[j]), start_of(squares[i, j], sixes[i, j])) for i, j in dict.fromkeys(order)]


def _dips(left: np.ndarray) -> list[tuple[int, int]]:
    """Where values (k, j) of both effects leave less than those about them, the deepest first: events show so, though at other
    moments an inertia that no body can have may leave less, or two events at one moment, which part the record in two."""
    from scipy.ndimage import median_filter, minimum_filter

    low = np.maximum(left, 1e-300)
    depth = np.log(median_filter(low, WINDOW, mode="nearest") / low)
    depth[low > minimum_filter(low, 3, mode="nearest")] = 0.0
    order = [divmod(int(k), left.shape[1]) for k in np.argsort(-depth, axis=None)[:LOCAL_MINIMA]]
    return [k for k in order if depth[k] > LEAST_DIP]
