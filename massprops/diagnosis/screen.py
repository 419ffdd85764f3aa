"""Effects solved for along measured rates, each in a few linear solutions: which are worth a fit, and where it begins.

Nothing is searched here. Along rates (a gyroscope's, or attitudes' by local polynomials) every row is one measured rate,
so a solution is a small linear system. An event is screened without the rows whose polynomials reach across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.diagnosis.conserved_start import Start, conserved
from massprops.diagnosis.criteria import SHAPE_SD, WIDE
from massprops.diagnosis.effect_columns import Term, forcing_of
from massprops.diagnosis.momentum_balance import INERTIA, Balance, Forcing, Rows, inertia_of, shape_of
from massprops.diagnosis.record import Record

PASSES = 3
FEWEST_KEPT = 8
"""Rows that must be left beside an event."""
LARGEST_STEP = 1.0
"""Of the logarithms of second moments in one pass."""


@dataclass(frozen=True, kw_only=True)
class Screened:
    """What a screen found.

    Attributes:
        terms: the effects with their scanned values; score: log likelihood with the noise marginalised, less half the
            logarithm of the rows for each unknown; left: rms of the rows over their noise; start: where a fit begins.
    """

    terms: tuple[Term, ...]
    score: float
    left: float
    start: Start


def screened(record: Record, terms: tuple[Term, ...], guess: Start) -> Screened | None:
    """The effects solved for together along the record's rates, about the inertia of `guess` and about what the balance
    conserves; None where too few rows are left beside an event.

    Args:
        record: of rates.
    """
    kept = beside_events(record, terms)
    if len(kept) < FEWEST_KEPT:
        return None
    rows = Rows(at=record.rows.at[kept], measured=record.rows.measured[kept], sigma=record.rows.sigma[kept], rates=True)
    forcing = joined(
        [forcing_of(t, record.path, record.path.w, guess.inertia, record.environment_state) for t in terms]
    )
    solutions = []
    for start, begun in ((guess, forcing), (conserved(record.path, rows.at, forcing), None)):
        solutions.append(_solved(record, rows, terms, start, begun))
    return max(solutions, key=lambda s: s.score)


def beside_events(record: Record, terms: tuple[Term, ...]) -> np.ndarray:
    """Rows whose local polynomials do not reach across an event of the terms."""
    use = np.ones(len(record.times), bool)
    for term in terms:
        held = dict(term.held)
        if "time" in held:
            begins, ends = held["time"], held["time"] + held.get("duration", 0.0)
            use &= (record.times < begins - record.reach) | (record.times > ends + record.reach)
    return np.flatnonzero(use)


def joined(forcings: list[Forcing]) -> Forcing | None:
    """All unknowns of several in one; None of none."""
    if not forcings:
        return None

    def side(name: str) -> np.ndarray | None:
        parts = [getattr(f, name) for f in forcings]
        shape = next((p.shape[:2] for p in parts if p is not None), None)
        if shape is None:
            return None
        return np.concatenate(
            [np.zeros((*shape, f.count)) if p is None else p for f, p in zip(forcings, parts, strict=True)], axis=2
        )

    return Forcing(momentum=side("momentum"), internal=side("internal"), rate=side("rate"))


def _moved(terms: tuple[Term, ...], unknowns: np.ndarray) -> tuple[Term, ...]:
    """A single effect about the values that its unknowns lead to, where these are steps."""
    return tuple(t.moved(unknowns) for t in terms) if len(terms) == 1 and terms[0].moves else terms


def _widths(terms: tuple[Term, ...], wide: np.ndarray) -> np.ndarray:
    """Prior standard deviations of the terms' unknowns, those of `wide` where the effect says none."""
    out, first = wide.copy(), 0
    for term in terms:
        known = term.sd
        if known is not None:
            count = len(known)
            out[first : first + count] = known
        else:
            count = len(term.unknowns) * term.parts if term.prior is None else term.prior.shape[1]
        first += count
    return out


def _solved(record: Record, rows: Rows, terms: tuple[Term, ...], start: Start, begun: Forcing | None) -> Screened:
    """begun: the columns of all terms at the start, where they are known."""
    path, speed = record.path, record.speed
    shape, rate = shape_of(start.inertia), path.w
    L0 = np.mean(np.einsum("nij,nj->ni", path.R, path.w @ inertia_of(shape)), axis=0)
    over = 1.0 / rows.spread
    sd = np.concatenate([np.full(INERTIA, SHAPE_SD), np.full(3, WIDE * speed)])
    residual, unknowns = np.zeros(len(over)), 0
    for _ in range(PASSES):
        balance = Balance(path=path, shape=shape, momentum=path.w, rate=rate, rows=rows)
        forcing = begun or joined([forcing_of(t, path, rate, balance.inertia, record.environment_state) for t in terms])
        begun = None
        free = balance.free
        along = free if forcing is None else np.concatenate([free, balance.forced(forcing)], axis=2)
        X = along[rows.at].reshape(len(over), -1) * over[:, None]
        y = (rows.measured - balance.constant(L0)).reshape(-1) * over + X[:, :INERTIA] @ shape
        G = X.T @ X
        scale = np.maximum(np.sqrt(np.diag(G) / len(X)), 1e-300)
        wide = np.concatenate([sd, _widths(terms, 1e3 / scale[len(sd) :])])
        x = wide * np.linalg.solve(wide[:, None] * G * wide + np.eye(len(wide)), wide * (X.T @ y))
        residual, unknowns = y - X @ x, len(x)
        step = x[:INERTIA] - shape
        moved = along @ np.concatenate([step, x[INERTIA:]])
        rate = balance.rate_of(L0)[:, :, 0] + moved
        shape = shape + step * min(1.0, LARGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        L0 = L0 + x[INERTIA : INERTIA + 3]
    mean_square = float(residual @ residual) / len(residual)
    count, believed = 3 * len(record.times), record.noise_rows
    # rows left out beside an event count as noise: leaving them out is no merit
    square = len(residual) * mean_square + (count - len(residual)) * max(1.0, mean_square)
    score = -0.5 * (count + believed) * np.log((square + believed) / (count + believed)) - 0.5 * unknowns * np.log(
        count
    )
    return Screened(
        terms=_moved(terms, x[len(sd) :]), score=float(score), left=float(np.sqrt(mean_square)),
        start=Start(inertia=inertia_of(shape), left=float(np.sqrt(mean_square))),
    )  # fmt: skip
