"""A named effect fitted once more by the equations of motion themselves.

The balance of momentum takes an effect along the path as it is: how a torque changes where the path turns, and how momentum inside
answers the rate, is no part of its derivatives. Its passes come to rest all the same, but not quite where the measurements are
likeliest, and its covariance is off for what acts strongly: a dipole that turns the momentum by as much as itself, a mass near
resonance, a gradient that depends on the inertia. So what is told of a record of attitudes is the answer of Gauss and Newton's
method with the derivatives of the motion (`dynamics.sensitivities`), under the priors and the noise that the balance found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from massprops.core.linalg import consecutive
from massprops.diagnosis.criteria import SHAPE_SD
from massprops.diagnosis.effect_columns import Term, term_of
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.momentum_balance import INERTIA, inertia_jacobian, inertia_of
from massprops.diagnosis.motion_path import MotionPath
from massprops.diagnosis.record import along, attitudes_of
from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, normalise, rotation_vector
from massprops.dynamics.rotation import ActiveEffects, Trajectory, trajectory
from massprops.dynamics.sensitivities import sensitivities
from massprops.effects import is_users

STEPS, STEPS_BESIDE = 20, 8
"""Most of the search for the likeliest, and for a point of a valley from the one before."""
RESTS = 0.02
"""Of half the squared residuals with the prior's, expected of a step, below which the search ends."""
FIRST_DAMPING, MORE, LESS, MOST = 1e-6, 10.0, 0.1, 1e4
"""Of Levenberg and Marquardt's method, over the diagonal."""
FIRST_STEP, GROWS = 0.6, 1.3
"""First step along a valley over the 1-sigma at the likeliest, and by how much each is longer than the one before."""
LONGEST_STEP = 0.2
"""Over the unknown's own scale (`momentum_sd`): a fifth of a frequency."""
MOST_POINTS = 8
"""To either side."""
FALL = 4.0
"""Of the log density at which a side ends: what lies beyond has a fiftieth of the weight."""
START = 6
"""Unknowns of the motion at the start: attitude and rate."""


@dataclass(frozen=True)
class _ActiveEffect:
    """An effect about whose held values unknowns x (k,) are counted, the last of them steps of the logarithms of its paces."""

    term: Term
    x: np.ndarray

    @property
    def paces(self) -> tuple[str, ...]:
        """Values that are held elsewhere, but smooth: time constants, not times."""
        held = dict(self.term.held)
        return tuple(
            q.name for q in self.term.effect.PARAMETERS if q.kind == "pace" and q.name in held and not self.term.moves
        )

    @property
    def here(self) -> np.ndarray:
        """(k,) half of what the effect is quadratic in (`momentum_here`), which its unknowns lack."""
        bend = self.term.here(len(self.x))
        return np.zeros(len(self.x)) if bend is None else bend

    def moved(self, d: np.ndarray) -> _ActiveEffect:
        """After a step d (k,)."""
        new = self.x + d
        if self.term.moves:
            term = self.term.moved(new)
            again = term.here(len(new))
            return _ActiveEffect(term, np.zeros(len(new)) if again is None else again)
        count, held = len(new) - len(self.paces), dict(self.term.held)
        held |= {
            name: held[name] * float(np.exp(np.clip(v, -1.0, 1.0)))
            for name, v in zip(self.paces, new[count:], strict=True)
        }
        return _ActiveEffect(term_of(self.term.effect, held), np.append(new[:count], np.zeros(len(self.paces))))

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.term.unknowns, *self.paces)

    @cached_property
    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (j,) by `names`, and their derivatives (j, k) by the unknowns."""
        held, count = dict(self.term.held), len(self.x) - len(self.paces)
        values, by = self.term.values_by_unknowns(self.x[:count])
        paces = np.array([held[n] for n in self.paces])
        slopes = np.zeros((len(values) + len(paces), len(self.x)))
        slopes[: len(values), :count], slopes[len(values) :, count:] = by, np.diag(paces)
        return np.concatenate([values, paces]), slopes


@dataclass(frozen=True)
class _Motion:
    """Where the search stands: attitude q (4,) and rate w (3,) at the start, shape (5,) of the inertia, and the effects."""

    q: np.ndarray
    w: np.ndarray
    shape: np.ndarray
    active: tuple[_ActiveEffect, ...]

    def moved(self, d: np.ndarray) -> _Motion:
        """After a step d (all,) of everything."""
        start, shape = d[:START], d[START : START + INERTIA]
        q = normalise(multiply(self.q, from_rotation_vector(start[:3])))
        active = tuple(a.moved(d[place]) for a, place in zip(self.active, self.places, strict=True))
        return _Motion(q, self.w + start[3:], self.shape + shape, active)

    @property
    def places(self) -> list[slice]:
        """Of each effect's unknowns among all."""
        return consecutive((len(a.x) for a in self.active), START + INERTIA)


class _Problem:
    """The likelihood of a record's attitudes under a fit's effects, noise and priors."""

    def __init__(self, fit: HypothesisFit) -> None:
        record, terms = fit.record, fit.hypothesis.terms
        assert record.environment is not None
        self.environment = record.environment
        self.times, self.span = record.times, float(record.path.t[-1])
        self.attitudes = attitudes_of(record)
        self.over = 1.0 / (record.rows.sigma * fit.noise[0])
        self.found = {t.name: fit.posterior.sd[t.name] for t in terms}
        self.places = tuple(consecutive(len(t.effect.PARAMETERS) for t in terms))
        self.active = ActiveEffects(tuple(t.effect for t in terms), self.places)

    def sd(self, at: _Motion) -> np.ndarray:
        """(all,) prior 1-sigma of the unknowns, infinite of those of the start and of paces."""
        out = [np.full(START, np.inf), np.full(INERTIA, SHAPE_SD)]
        for a in at.active:
            out += [self.found[a.term.name] if a.term.sd is None else a.term.sd, np.full(len(a.paces), np.inf)]
        return np.concatenate(out)

    def log_prior(self, at: _Motion) -> float:
        """Log density of the effects' values beyond that of `sd` (`momentum_log_prior`)."""
        priors = [
            (a.term.effect.momentum_log_prior, a) for a in at.active if hasattr(a.term.effect, "momentum_log_prior")
        ]
        return float(sum(f(a.values[0][: len(a.term.unknowns)]) for f, a in priors))

    def open(self, at: _Motion) -> np.ndarray:
        """(all,) precision of laws that are only about the present values (`MOMENTUM_OPEN`)."""
        out = np.zeros(len(self.sd(at)))
        for a, place in zip(at.active, at.places, strict=True):
            names = getattr(a.term.effect, "MOMENTUM_OPEN", ())
            out[[place.start + a.term.unknowns.index(n) for n in names]] = 1.0
        return out * self.sd(at) ** -2.0

    def prior_residuals(self, at: _Motion) -> np.ndarray:
        """(all,) what the prior is about over its 1-sigma, zero of what is free: an effect's values, not its unknowns."""
        effect_values = [a.x + a.here for a in at.active]
        return np.concatenate([np.zeros(START), at.shape, *effect_values]) / self.sd(at)

    def parameters(self, at: _Motion) -> tuple[np.ndarray, np.ndarray]:
        """The effects' parameters (p,) in one vector, and their derivatives (p, k) by the unknowns."""
        flat: list[float] = []
        slopes = np.zeros((self.places[-1].stop, sum(len(a.x) for a in at.active)))
        for a, of_unknowns, place in zip(at.active, at.places, self.places, strict=True):
            names, (values, by) = [q.name for q in a.term.effect.PARAMETERS], a.values
            held = dict(a.term.held) | {"span": self.span} | dict(zip(a.names, values, strict=True))
            flat += [float(held.get(n, 0.0)) for n in names]
            first = START + INERTIA
            slopes[
                [place.start + names.index(n) for n in a.names], of_unknowns.start - first : of_unknowns.stop - first
            ] = by
        return np.array(flat), slopes

    def motion(self, at: _Motion, times: np.ndarray) -> Trajectory:
        """The motion at times (n,)."""
        p, _ = self.parameters(at)
        return trajectory(times, at.q, at.w, inertia_of(at.shape), self.active, p, self.environment)

    def residual(self, at: _Motion) -> tuple[Trajectory, np.ndarray]:
        """The motion at the measurements, and (m, 3) these less its attitudes, over their noise."""
        motion = self.motion(at, self.times)
        turn = rotation_vector(multiply(conjugate(motion.q), self.attitudes))
        return motion, np.asarray(turn * self.over[:, None])

    def slopes(self, at: _Motion, motion: Trajectory) -> np.ndarray:
        """(3 m, all) of the predicted attitudes by all unknowns, over their noise."""
        p, by = self.parameters(at)
        turn, _ = sensitivities(
            self.times, motion, at.q, at.w, inertia_of(at.shape), inertia_jacobian(at.shape), self.active, p, self.environment
        )  # fmt: skip
        over_noise, first = turn * self.over[:, None, None], START + INERTIA
        return np.concatenate([over_noise[:, :, :first], over_noise[:, :, first:] @ by], axis=2).reshape(
            -1, first + by.shape[1]
        )


@dataclass(frozen=True)
class _Point:
    """Where a search came to rest. motion, residual (m, 3): there; cost: half the squares, the prior's too; precision (all, all), sd
    (all,): of all unknowns, and of the prior, one where that is free; log_prior, open (all,): see `_Problem`."""

    at: _Motion
    motion: Trajectory
    residual: np.ndarray
    cost: float
    precision: np.ndarray
    sd: np.ndarray
    log_prior: float
    open: np.ndarray

    def density(self, held: int) -> float:
        """Log density of an unknown that stays, all else marginalised (Laplace's approximation)."""
        rest = np.delete(np.arange(len(self.sd)), held)
        scaled = self.precision[np.ix_(rest, rest)] * np.outer(self.sd[rest], self.sd[rest])
        return float(self.log_prior - self.cost - 0.5 * np.linalg.slogdet(scaled)[1])

    def covariance(self, held: int | None = None) -> np.ndarray:
        """(all, all) of the unknowns, with one that stays."""
        rest = np.delete(np.arange(len(self.sd)), [] if held is None else [held])
        out, precision = np.zeros_like(self.precision), self.precision - np.diag(self.open)
        out[np.ix_(rest, rest)] = np.linalg.inv(precision[np.ix_(rest, rest)])
        return out


def has_whole_motion(fit: HypothesisFit) -> bool:
    """Whether a fit's effects have equations of motion: no unknown torque, wheel of any history or push in parts; of attitudes alone
    whose errors are independent."""
    hypothesis, rows = fit.hypothesis, fit.record.rows
    unknown = (
        hypothesis.wheel or hypothesis.latent or hypothesis.inertial or hypothesis.by_sun or hypothesis.memory > 0.0
    )
    plain = all(t.parts == 1 and not is_users(t.effect) for t in hypothesis.terms)
    return bool(hypothesis.terms) and plain and not unknown and not rows.rates and rows.gyroscope is None


def by_whole_motion(fit: HypothesisFit) -> HypothesisFit:
    """The fit at the likeliest values of all but moments and lengths of events, with their covariance; the fit itself where it has no
    such equations (`has_whole_motion`), or these lead nowhere."""
    if not has_whole_motion(fit):
        return fit
    with np.errstate(all="ignore"):
        try:
            problem = _Problem(fit)
            points, weights, held = _valley(problem, _likeliest(problem, _begun(fit)))
        except np.linalg.LinAlgError:
            return fit
        motion = problem.motion(points[0].at, fit.record.path.t)
    return _told(fit, motion, points, weights, held)


def _begun(fit: HypothesisFit) -> _Motion:
    active = []
    for term in fit.hypothesis.terms:
        x = fit.posterior.mean[term.name]
        if term.moves:  # the hypothesis has it where the last pass began
            term = term.moved(x)
            here = term.here(len(x))
            assert here is not None
            x = here
        active.append(_ActiveEffect(term, np.append(x, np.zeros(len(_ActiveEffect(term, x).paces)))))
    return _Motion(fit.record.path.q[0], fit.rate[0], fit.shape, tuple(active))


def _valley(problem: _Problem, best: _Point) -> tuple[list[_Point], np.ndarray, int | None]:
    """Points of the posterior with their weights, the first where what is told is told, and the unknown that they hold: along an
    effect's own valley (`MOMENTUM_VALLEY`), or the likeliest alone where it has none.

    Raises:
        numpy.linalg.LinAlgError: nothing is known there.
    """
    for a, place in zip(best.at.active, best.at.places, strict=True):
        named = getattr(a.term.effect, "MOMENTUM_VALLEY", None)
        if named is None:
            continue
        held = place.start + a.term.unknowns.index(named)
        points = [*_side(problem, best, held, -1.0)[::-1], best, *_side(problem, best, held, 1.0)]
        logarithms = np.log([_held(p, named) for p in points])
        density = np.array([p.density(held) for p in points])
        weights = (np.gradient(logarithms) if len(points) > 1 else np.ones(1)) * np.exp(density - density.max())
        weights /= weights.sum()
        middle = int(np.argmin(np.abs(logarithms - weights @ logarithms)))
        order = [middle, *(k for k in range(len(points)) if k != middle)]
        return [points[k] for k in order], weights[order], held
    return [best], np.ones(1), None


def _held(point: _Point, named: str) -> float:
    return next(dict(a.term.held)[named] for a in point.at.active if named in dict(a.term.held))


def _side(problem: _Problem, best: _Point, held: int, sign: float) -> list[_Point]:
    """To one side of the likeliest, until the density has fallen or nothing can be there."""
    out: list[_Point] = []
    here, highest = best, best.density(held)
    longest = LONGEST_STEP * best.sd[held]
    step = min(FIRST_STEP * float(np.sqrt(best.covariance()[held, held])), longest)
    for _ in range(MOST_POINTS):
        point = _beside(problem, here, held, sign * step)
        # a long step along a curved valley may have left it
        if point is None or point.density(held) < highest - FALL:
            shorter = _beside(problem, here, held, 0.4 * sign * step)
            point = shorter if shorter is not None else point
        if point is None:
            break
        out.append(point)
        density = point.density(held)
        if density < highest - FALL:
            break
        here, highest, step = point, max(highest, density), min(GROWS * step, longest)
    return out


def _beside(problem: _Problem, here: _Point, held: int, step: float) -> _Point | None:
    """The likeliest with an unknown moved by a step and held there; None where nothing can be there."""
    way = here.covariance()[:, held]
    try:
        point = _likeliest(problem, here.at.moved(way * (step / way[held])), held)
        return point if np.isfinite(point.density(held)) else None
    except np.linalg.LinAlgError:
        return None


def _likeliest(problem: _Problem, at: _Motion, held: int | None = None) -> _Point:
    """Where Levenberg and Marquardt's method comes to rest; held: an unknown that stays.

    Raises:
        numpy.linalg.LinAlgError: it leads nowhere.
    """
    motion, residual = problem.residual(at)
    cost, damping = _cost(residual, problem.prior_residuals(at)), FIRST_DAMPING
    free = np.delete(np.arange(len(problem.sd(at))), [] if held is None else [held])
    step = np.zeros(len(problem.sd(at)))
    for _ in range(STEPS if held is None else STEPS_BESIDE):
        J, sd = problem.slopes(at, motion), problem.sd(at)
        H, downhill = J.T @ J + np.diag(sd**-2), J.T @ residual.reshape(-1) - problem.prior_residuals(at) / sd
        if not np.isfinite(H).all():
            raise np.linalg.LinAlgError("the derivatives leave all bounds")
        here = _Point(
            at=at, motion=motion, residual=residual, cost=cost, precision=H, sd=np.where(np.isfinite(sd), sd, 1.0),
            log_prior=problem.log_prior(at), open=problem.open(at),
        )  # fmt: skip
        curvature, by = H[np.ix_(free, free)], downhill[free]
        if 0.5 * float(by @ np.linalg.solve(curvature, by)) < RESTS:
            break
        while damping < MOST:
            step[free] = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), by)
            new = at.moved(step)
            new_motion, new_residual = problem.residual(new)
            new_cost = _cost(new_residual, problem.prior_residuals(new))
            if new_cost < cost:
                break
            damping *= MORE
        else:
            break
        at, motion, residual, cost = new, new_motion, new_residual, new_cost
        damping = max(damping * LESS, FIRST_DAMPING)
    return here


def _cost(residual: np.ndarray, prior_residuals: np.ndarray) -> float:
    cost = 0.5 * float(np.sum(residual**2) + np.sum(prior_residuals**2))
    return cost if np.isfinite(cost) else np.inf


def _told(
    fit: HypothesisFit, motion: Trajectory, points: list[_Point], weights: np.ndarray, held: int | None
) -> HypothesisFit:
    """The fit at the first point, with mean squares about it over all of them."""
    told, path = points[0].at, MotionPath(t=fit.record.path.t, q=motion.q, w=motion.w)
    base = fit.posterior.covariance["base"].copy()
    base[:INERTIA, :INERTIA] = 0.0
    spread = [np.zeros((len(a.names), len(a.names))) for a in told.active]
    for point, weight in zip(points, weights, strict=True):
        joint, off = point.covariance(held), point.at.shape - told.shape
        inertia = slice(START, START + INERTIA)
        base[:INERTIA, :INERTIA] += weight * (joint[inertia, inertia] + np.outer(off, off))
        for a, first, mean_square, k in zip(point.at.active, told.active, spread, point.at.places, strict=True):
            by, off = a.values[1], a.values[0] - first.values[0]
            mean_square += weight * (by @ joint[k, k] @ by.T + np.outer(off, off))
    counts = {a.term.name: len(a.term.unknowns) for a in told.active}
    post = fit.posterior
    sd = {a.term.name: dict(zip(a.paces, np.sqrt(np.diag(c))[counts[a.term.name] :].tolist(), strict=True))
          for a, c in zip(told.active, spread, strict=True) if a.paces}  # fmt: skip
    return replace(
        fit, hypothesis=replace(fit.hypothesis, terms=tuple(a.term for a in told.active)), shape=told.shape,
        inertia=inertia_of(told.shape), rate=motion.w, record=along(fit.record, path, attitudes_of(fit.record)),
        values={a.term.name: a.values[0][: counts[a.term.name]] for a in told.active},
        covariance={a.term.name: c[: counts[a.term.name], : counts[a.term.name]] for a, c in zip(told.active, spread, strict=True)},
        residual=points[0].residual * fit.noise[0], posterior=replace(post, covariance={**post.covariance, "base": base}),
        held_sd={**fit.held_sd, **sd},
    )  # fmt: skip
