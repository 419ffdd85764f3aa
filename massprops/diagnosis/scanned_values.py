"""What is told of an effect that is named: along a finer path, and with what the record leaves open of the values that its
columns hold, such as the time of a knock.

These are scanned, then moved to their best; all else is solved for at given values. The evidence about the best is taken
for a normal law (Laplace's approximation), and what the solved unknowns move by with them joins their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from massprops.diagnosis.criteria import ALIKE, SCALES
from massprops.diagnosis.effect_columns import Term, steps, term_of
from massprops.diagnosis.effect_search import admissible, again
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.record import with_points
from massprops.diagnosis.wheel_moment import with_open_moment
from massprops.diagnosis.whole_motion import by_whole_motion, has_whole_motion

FALL = (1.0, 6.0)
"""Of the log evidence over a step by which its curvature is measured: a sigma is a fall of a half. Less is near what two fits
of one hypothesis differ by (`hypothesis_fit.SETTLED`), more lies where the law need not be normal."""
WANTED = 2.5
"""The fall that a step along an axis of the law is begun with."""
ABOUT, FINER = 3.0, 8
"""Measurements before and after an event between which the path has so many points for each."""
LARGEST_STEP = np.radians(1.5)
"""Turn over which a step of the path is halved. By steps of 3 degrees the trapezoid moves a kick by up to 1.1 of its sigma, by
steps of 1.5 by up to 0.3 (ten firings of Basilisk without noise: mean square 0.16 and 0.007 of the variance)."""
LENGTHS = (0.5, 1.0, 2.0, 3.0)
"""Of an event, in measurements, that are tried about its middle: along the path's own steps shorter ones are all alike."""
PER_GAP, FARTHEST, FALLEN = 2, 8, 5.0
"""Moments of an event that happens at once that are tried between two measurements, as many of these to either side at most, and the
fall of the log evidence after which no further ones are."""
LENGTH_STEP, MOST_LENGTHS = 0.35, 12
"""Of log(1 + length / gap) between the lengths of an event that are tried where the shortest may do, and the most of them: a
length may have any order of magnitude, but what is shorter than the gap between measurements is all alike."""
TRIES = 8
ROUNDS = 4
FLAT = 0.1
"""Least curvature over a step's square: along what the record does not show at all, a sigma is three steps."""
FAR = 0.15
"""Steps from the best by the curvature's own account at which the values are moved there, and looked at once more."""


class _Astray(Exception):
    """A step led nowhere."""


@dataclass(frozen=True)
class _Law:
    """The normal law of n held values about those of a fit.

    Attributes:
        axes: (n, n) in columns, steps along which the evidence falls by some; curvature: (n, n) of its fall over them.
        gradient: (n,) of the evidence over them; slopes: by effect, (k, n) of its parameters over them.
    """

    axes: np.ndarray
    curvature: np.ndarray
    gradient: np.ndarray
    slopes: dict[str, np.ndarray]

    @property
    def spread(self) -> np.ndarray:
        """(n, n) covariance over the axes."""
        values, turn = np.linalg.eigh(self.curvature)
        return np.asarray(turn / np.maximum(values, FLAT) @ turn.T)

    @property
    def principal(self) -> np.ndarray:
        """(n, n) in columns, uncorrelated steps along which the evidence falls by `WANTED`."""
        values, turn = np.linalg.eigh(self.curvature)
        return np.asarray(self.axes @ turn * np.sqrt(2.0 * WANTED / np.maximum(values, FLAT)))


def with_scanned(fit: HypothesisFit, gap: float) -> HypothesisFit:
    """The fit along a finer path, at the best of its scanned values, with their 1-sigma (`held_sd`) and what they add to its
    covariance.

    Where an event may be as short as the path can tell, its length is summed over; where the evidence about the best cannot be told,
    the lengths of all events are; else the fit is returned as it is.

    Args:
        gap: between measurements [s].
    """
    places = _places(fit, gap)
    fit = _of_any_length(_finer(fit, gap), gap)
    if not places:
        return with_open_moment(by_whole_motion(fit))
    at_once = len(places) == 1 and places[0].name == "time"
    told = _over_moments(fit, places[0], gap) if at_once else None
    if told is not None:
        return told
    lasting = [p for p in places if p.name == "duration"]
    short = [p for p in lasting if _may_be_shortest(fit, p, gap)]
    for summed in [short] if short == lasting else [short, lasting]:
        told = _told(fit, [p for p in places if p not in summed]) if len(summed) < len(places) else None
        if told is not None:
            return _over_lengths(told, summed, gap)
    return by_whole_motion(fit)


def _over_moments(fit: HypothesisFit, place: _Place, gap: float) -> HypothesisFit | None:
    """The fit at the likeliest moment of an event that happens at once, with what the moment leaves open: its evidence summed over
    moments, as it has an end between each two measurements, where what happens follows the noise of the next ones. None where it does
    not fall so soon: then the law about the best says as much."""
    tried = [fit]
    for sign in (-1.0, 1.0):
        for k in range(1, FARTHEST * PER_GAP + 1):
            neighbour = _moved(fit, [place], np.array([sign * k * gap / PER_GAP]))
            if neighbour is None:
                return None
            tried.append(neighbour)
            if neighbour.evidence < max(f.evidence for f in tried) - FALLEN:
                break
        else:
            return None
    tried.sort(key=lambda f: f.evidence)
    best, weights = tried[-1], np.exp([f.evidence - tried[-1].evidence for f in tried])
    weights /= weights.sum()
    told = by_whole_motion(best)
    covariance = {
        name: within + np.sum([w * np.outer(d, d) for w, f in zip(weights, tried, strict=True) for d in [f.values[name] - best.values[name]]], axis=0)
        for name, within in told.covariance.items()
    }  # fmt: skip
    name = fit.hypothesis.terms[place.term].name
    moments = np.array([dict(f.hypothesis.terms[place.term].held)[place.name] for f in tried])
    sd = float(np.sqrt(weights @ (moments - moments[-1]) ** 2 + (gap / PER_GAP) ** 2 / 12.0))
    return replace(told, covariance=covariance, held_sd={**told.held_sd, name: {place.name: sd}})


def _told(fit: HypothesisFit, places: list[_Place]) -> HypothesisFit | None:
    """The fit at the best of the places, with their 1-sigma; None where a step leads nowhere."""
    try:
        # a knock's time and duration are known far worse than its middle: the law's own axes are found first
        axes = _law(fit, places, np.diag([p.step for p in places])).principal
        for _ in range(ROUNDS):
            law = _law(fit, places, axes)
            best = law.spread @ law.gradient
            moved = _moved(fit, places, law.axes @ np.clip(best, -1.0, 1.0)) if np.abs(best).max() > FAR else None
            if moved is None or not moved.evidence > fit.evidence:
                break
            fit, axes = moved, law.principal
    except _Astray:
        return None
    return _widened(fit, places, law)


def _lasting(fit: HypothesisFit, which: int, length: float, event: Term | None = None) -> HypothesisFit | None:
    """The fit with another length of an event, one of its terms, about the same middle, or that of `event`; None where that leads nowhere."""
    terms = list(fit.hypothesis.terms)
    event = event or terms[which]
    held = dict(event.held)
    middle = held["time"] + 0.5 * held["duration"]
    terms[which] = term_of(event.effect, held | {"time": middle - 0.5 * length, "duration": length})
    return admissible(fit.record, replace(fit.hypothesis, terms=tuple(terms)), again(fit), fit.hypothesis.latent)


def _may_be_shortest(fit: HypothesisFit, place: _Place, gap: float) -> bool:
    """Whether an event may be as short as the path's own steps, so that its length has no normal law."""
    shortest = _lasting(fit, place.term, gap / FINER)
    return shortest is not None and shortest.evidence > fit.evidence - FALLEN


def _over_lengths(fit: HypothesisFit, summed: list[_Place], gap: float) -> HypothesisFit:
    """With what events' lengths leave open of these, of the moments at which they begin and of all else: the evidence summed over
    lengths about the same middle, from the shortest on until it has fallen."""
    covariance = dict(fit.covariance)
    held = {name: dict(of_effect) for name, of_effect in fit.held_sd.items()}
    for place in summed:
        name, of_effect = fit.hypothesis.terms[place.term].name, dict(fit.hypothesis.terms[place.term].held)
        here, tried = _lasting(fit, place.term, of_effect["duration"]), _by_length(fit, place, gap)
        if here is None or not tried:
            continue
        weights = np.exp([f.evidence - max(f.evidence for f in tried) for f in tried])
        weights /= weights.sum()
        spread = held.setdefault(name, {})
        for value in ("time", "duration"):
            off = np.array([dict(f.hypothesis.terms[place.term].held)[value] for f in tried]) - of_effect[value]
            spread[value] = float(np.sqrt(spread.get(value, 0.0) ** 2 + weights @ off**2))
        for effect in covariance:
            off = np.array([f.values[effect] for f in tried]) - here.values[effect]
            covariance[effect] = covariance[effect] + (weights * off.T) @ off
    return replace(fit, covariance=covariance, held_sd=held)


def _by_length(found: HypothesisFit, place: _Place, gap: float) -> list[HypothesisFit]:
    """Fits with an event from the shortest that the path tells on, each as much longer as the ones before are over a gap, until the
    evidence has fallen."""
    out: list[HypothesisFit] = []
    for k in range(MOST_LENGTHS):
        fit = _lasting(found, place.term, gap * ((1.0 + 1.0 / FINER) * np.exp(k * LENGTH_STEP) - 1.0))
        if fit is None or fit.evidence < max([f.evidence for f in out], default=-np.inf) - FALLEN:
            break
        out.append(fit)
    return out


def at_likely_scale(fit: HypothesisFit) -> HypothesisFit:
    """The fit under the smallest prior of the gyroscope's scale and misalignment that is as likely as any, where rates alone were
    measured: the smallest moment of a slender body moves by as many percent as these errors have tenths of a percent."""
    if not fit.record.rows.rates:
        return fit
    start, latent = again(fit), fit.hypothesis.latent
    others = (admissible(fit.record, replace(fit.hypothesis, scale=s), start, latent) for s in SCALES)
    fits = [*(f for f in others if f is not None), fit]
    likeliest = max(f.evidence for f in fits)
    return next(f for f in fits if f.evidence > likeliest - ALIKE)


@dataclass(frozen=True)
class _Place:
    """A held value: of which term, its name, the step its search had, and whether it may be negative."""

    term: int
    name: str
    step: float
    signed: bool


def _places(fit: HypothesisFit, gap: float) -> list[_Place]:
    out, whole = [], has_whole_motion(fit)
    for k, term in enumerate(fit.hypothesis.terms):
        held, kinds = dict(term.held), {q.name: q.kind for q in term.effect.PARAMETERS}
        for name, step in steps(term, gap).items():
            signed = kinds[name] == "direction"
            smooth = whole and kinds[name] == "pace"  # an unknown of the whole motion
            if not smooth and (signed or held[name] > 0.0):
                out.append(_Place(k, name, step if signed else min(step, 0.5 * held[name]), signed))
    return out


def _finer(fit: HypothesisFit, gap: float) -> HypothesisFit:
    """The fit along a path with its longer steps halved, and with more points about its events, so that one can begin and end
    between two measurements: by the path's own steps a kick moves by its sigma with where they happen to lie."""
    more = [_halfway(fit)]
    for term in fit.hypothesis.terms:
        held = dict(term.held)
        if "time" in held:
            begins, ends = held["time"] - ABOUT * gap, held["time"] + held.get("duration", 0.0) + ABOUT * gap
            more.append(np.arange(begins, ends, gap / FINER))
    points = np.unique(np.concatenate(more))
    if not len(points):
        return fit
    record, start = with_points(fit.record, points), again(fit)
    if fit.history is not None:
        start = replace(start, history=np.interp(record.path.t, fit.record.path.t, fit.history))
    return admissible(record, fit.hypothesis, start, fit.hypothesis.latent) or fit


def _of_any_length(fit: HypothesisFit, gap: float) -> HypothesisFit:
    """The likeliest of the fit and of those whose events last otherwise about the same middle."""
    best = fit
    for k, term in enumerate(fit.hypothesis.terms):
        held = dict(term.held)
        if held.get("duration", 0.0) <= 0.0 or held.get("parts", 1) != 1:
            continue
        for length in (n * gap for n in LENGTHS):
            other = _lasting(best, k, length, term)
            best = other if other is not None and other.evidence > best.evidence else best
    return best


def _halfway(fit: HypothesisFit) -> np.ndarray:
    """Times (k,) in the middle of the path's longer steps; none along a gyroscope's own path, which its rates make."""
    path = fit.record.path
    if fit.record.rows.rates:
        return np.zeros(0)
    long = np.linalg.norm(path.steps, axis=1) * np.diff(path.t) > LARGEST_STEP
    return np.asarray(0.5 * (path.t[1:] + path.t[:-1])[long])


def _moved(found: HypothesisFit, places: list[_Place], by: np.ndarray) -> HypothesisFit | None:
    """The fit with its held values moved by (n,); None where that leads nowhere."""
    terms = list(found.hypothesis.terms)
    for place, step in zip(places, by, strict=True):
        held = dict(terms[place.term].held)
        held[place.name] += float(step)
        if not place.signed and held[place.name] <= 0.0:
            return None
        terms[place.term] = term_of(terms[place.term].effect, held)
    moved = replace(found.hypothesis, terms=tuple(terms))
    return admissible(found.record, moved, again(found), moved.latent)


def _law(fit: HypothesisFit, places: list[_Place], axes: np.ndarray) -> _Law:
    """The normal law by steps along `axes` (n, n), each made longer or shorter until the evidence falls as `FALL` says.

    Raises:
        _Astray: a step leads nowhere.
    """

    def at(by: np.ndarray) -> HypothesisFit:
        moved = _moved(fit, places, by)
        if moved is None:
            raise _Astray
        return moved

    axes, n = axes.copy(), len(places)
    E = at(np.zeros(n)).evidence  # as its neighbours are fitted
    ups, downs = [], []
    for i in range(n):
        most = np.inf
        for attempt in range(TRIES):
            up, down = _moved(fit, places, axes[:, i]), _moved(fit, places, -axes[:, i])
            fall = np.inf if up is None or down is None else E - 0.5 * (up.evidence + down.evidence)
            change = 0.5 if fall > FALL[1] else 2.0 if fall < FALL[0] else 1.0
            if change == 1.0 or attempt == TRIES - 1 or (change > 1.0 and most <= 2.0):
                break
            most = 1.0 if change < 1.0 else most
            axes[:, i] *= change
            most /= change
        if up is None or down is None:
            raise _Astray
        ups.append(up)
        downs.append(down)
    up_, down_ = np.array([f.evidence for f in ups]), np.array([f.evidence for f in downs])
    curvature = np.diag(2.0 * E - up_ - down_)
    for i, j in combinations(range(n), 2):
        both = at(axes[:, i] + axes[:, j]).evidence + at(-axes[:, i] - axes[:, j]).evidence
        curvature[i, j] = curvature[j, i] = -0.5 * (both + 2.0 * E - up_[i] - down_[i] - up_[j] - down_[j])
    slopes = {
        t.name: np.stack([0.5 * (a.values[t.name] - b.values[t.name]) for a, b in zip(ups, downs, strict=True)], axis=1)
        for t in fit.hypothesis.terms
    }
    return _Law(axes, curvature, 0.5 * (up_ - down_), slopes)


def _widened(fit: HypothesisFit, places: list[_Place], law: _Law) -> HypothesisFit:
    fit = by_whole_motion(fit)
    covariance = {
        name: covariance_before + law.slopes[name] @ law.spread @ law.slopes[name].T
        for name, covariance_before in fit.covariance.items()
    }
    sd = np.sqrt(np.diag(law.axes @ law.spread @ law.axes.T))
    held: dict[str, dict[str, float]] = {}
    for place, s in zip(places, sd, strict=True):
        held.setdefault(fit.hypothesis.terms[place.term].name, {})[place.name] = float(s)
    return replace(fit, covariance=covariance, held_sd={**fit.held_sd, **held})
