"""Before measuring: which effects of which size a planned record could show, and which it could tell apart.

Along the planned motion every effect has its columns in the balance of momentum (`momentum_balance`). What inertia,
momentum at the start and sensor would take up of them is taken away; what is left over the noise is the effect's
signal, and its square the noncentrality of the test for it (Basseville and Nikiforov 1993, section 7.2). An effect shows
from the size at which that test finds it nine times in ten. Two effects are told apart where the part of the one's signal
that the other cannot imitate shows in the same way: the isolability of fault diagnosis, as a factor on the size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from massprops.core.linalg import consecutive
from massprops.diagnosis.criteria import SHAPE_SD, SIGNIFICANT, WIDE
from massprops.diagnosis.effect_columns import Term, forcing_of, scan
from massprops.diagnosis.evidence import reduced
from massprops.diagnosis.hypothesis import sensor_sd
from massprops.diagnosis.momentum_balance import INERTIA, Balance, shape_of
from massprops.diagnosis.record import Record
from massprops.diagnosis.selection import usable_effects

POWER = 0.9
"""Of the test by which an effect is said to show."""
MOST_SCANNED = 9
"""Values of what is scanned that stand for an effect."""
APART = 10.0
"""Times the size at which it shows, up to which an effect counts as told apart from another."""
DIRECTIONS = 400
"""Directions of the parameters over which the middling one is taken."""
RANK = 1e-9
"""Part of the largest eigenvalue below which a combination of unknowns counts as not shown."""


@dataclass(frozen=True, kw_only=True)
class Signal:
    """An effect in a plan.

    Attributes:
        name, unit: of the effect and of its parameters; columns: those of each value that is scanned.
        shows_from: size of all its parameters together at which it shows, in a middling direction, by the scanned value;
            best, worst: in the direction that shows most and least (infinite where one does not show).
    """

    name: str
    unit: str
    columns: tuple[slice, ...]
    shows_from: float
    best: float
    worst: float


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Attributes:
    record: the planned record; signals: effects; apart: (e, e) factor on `shows_from` of the effect of the row from which
        it is told apart from that of the column, infinite for never; 1 on the diagonal. skipped: effects that need more.
    """

    record: Record
    signals: tuple[Signal, ...]
    apart: np.ndarray
    skipped: dict[str, str]

    @property
    def confused(self) -> list[tuple[str, str]]:
        """Pairs, the acting one first, that are not told apart up to `APART` times the size at which it shows."""
        n = [s.name for s in self.signals]
        rows, others = np.nonzero(self.apart > APART)
        return [(n[i], n[j]) for i, j in zip(rows, others, strict=True) if np.isfinite(self.signals[i].shows_from)]


@cache
def noncentrality(unknowns: int) -> float:
    """Noncentrality at which a chi-square test of so many unknowns at `SIGNIFICANT` has the power `POWER`."""
    from scipy.optimize import brentq
    from scipy.special import chdtri, chndtr  # scipy.stats takes a second to load

    limit = chdtri(unknowns, SIGNIFICANT)
    return float(brentq(lambda x: 1.0 - chndtr(limit, unknowns, x) - POWER, 1e-3, 1e4))


def plan(record: Record, inertia: np.ndarray) -> Plan:
    """What a record along this motion with this noise could show.

    Args:
        record: of a simulated free motion. inertia: (3, 3) that moved it.
    """
    shape = shape_of(inertia)
    rate = record.path.w
    balance = Balance(
        path=record.path, shape=shape, momentum=rate @ balance_inertia(inertia), rate=rate, rows=record.rows
    )
    usable, skipped = usable_effects(record)
    effects = [m for m in usable if not hasattr(m, "momentum_moved")]
    # `shows_from` means a size that enters linearly
    skipped |= {
        m.NAME: "its size does not enter linearly, so a plan cannot say from which size on it shows"
        for m in usable
        if m not in effects
    }
    terms, owners = [], []
    for effect in effects:
        every = scan(effect, record.times, rate[record.rows.at])
        keep = np.unique(np.linspace(0, len(every) - 1, min(MOST_SCANNED, len(every))).astype(int))
        terms += [every[k] for k in keep]
        owners += [effect] * len(keep)
    G, places = _information(record, balance, terms)
    signals = []
    for effect in effects:
        of_effect = [k for k, owner in enumerate(owners) if owner is effect]
        signals.append(_signal(effect, [terms[k] for k in of_effect], [places[k] for k in of_effect], G))
    apart = np.array([[1.0 if a is b else _factor(a, b, G) for b in signals] for a in signals])
    return Plan(record=record, signals=tuple(signals), apart=apart, skipped=skipped)


def balance_inertia(inertia: np.ndarray) -> np.ndarray:
    """(3, 3) of trace 3."""
    return np.asarray(3.0 * inertia / np.trace(inertia))


def _information(record: Record, balance: Balance, terms: list[Term]) -> tuple[np.ndarray, list[slice]]:
    """Inner products of all terms' columns over the noise, what every hypothesis has taken away; where each term lies."""
    over = 1.0 / record.rows.spread
    base = balance.base()
    sd = np.concatenate(
        [np.full(INERTIA, SHAPE_SD), np.full(3, WIDE * record.speed), np.full(balance.base_count - INERTIA - 3, WIDE)]
    )
    if record.rows.rates or record.rows.gyroscope is not None:
        columns = balance.sensor()
        base, sd = np.concatenate([base, columns], axis=2), np.concatenate([sd, sensor_sd(columns.shape[2])])
    parts = []
    for term in terms:
        columns = balance.columns(
            forcing_of(term, record.path, balance.rate, balance.inertia, record.environment_state)
        )
        parts.append(columns.reshape(len(over), -1) * over[:, None])
    fixed = base.reshape(len(over), -1) * over[:, None]
    G, _ = reduced(fixed, sd, np.concatenate(parts, axis=1), np.zeros(len(over)))
    return 0.5 * (G + G.T), consecutive(part.shape[1] for part in parts)


def _signal(effect: Any, terms: list[Term], places: list[slice], G: np.ndarray) -> Signal:
    """How large an effect must be to show, at a middling one of its scanned values."""
    sizes = []
    for place in places:
        value = np.linalg.eigvalsh(G[place, place])
        level = noncentrality(len(value))
        with np.errstate(divide="ignore"):
            each = np.sqrt(level / np.where(value > RANK * max(value[-1], 1e-300), value, 0.0))
        some = np.random.default_rng(0).normal(size=(DIRECTIONS, len(value)))
        gained = np.median(np.sum(some**2 * np.maximum(value, 0.0), axis=1) / np.sum(some**2, axis=1))
        sizes.append((float(np.sqrt(level / max(float(gained), 1e-300))), float(each[-1]), float(each[0])))
    middle = np.median(np.array(sizes), axis=0)
    units = {q.name: q.unit for q in effect.PARAMETERS}
    unit = units[terms[0].unknowns[0]]
    return Signal(
        name=effect.NAME, unit=unit, columns=tuple(places), shows_from=float(middle[0]),
        best=float(middle[1]), worst=float(middle[2]),
    )  # fmt: skip


def _factor(active: Signal, other: Signal, G: np.ndarray) -> float:
    """Factor on the size from which an effect is told apart from another, whose scanned values may be any of its own."""
    factors = []
    for active_place in active.columns:
        whole = float(np.trace(G[active_place, active_place]))
        unexplained = whole
        for place in other.columns:
            value, vector = np.linalg.eigh(G[place, place])
            seen = value > RANK * max(float(value[-1]), 1e-300)
            across = vector[:, seen].T @ G[place, active_place] / np.sqrt(value[seen])[:, None]
            unexplained = min(unexplained, whole - float(np.sum(across**2)))
        factors.append(np.sqrt(whole / unexplained) if unexplained > RANK * whole else np.inf)
    return float(np.median(factors))
