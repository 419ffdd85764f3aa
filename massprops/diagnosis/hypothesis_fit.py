"""One hypothesis fitted to a record by Gauss and Newton's method on the balance of momentum.

Each pass solves for everything that enters linearly: the inertia about the present one, momentum (and turn) at the start,
the effects, the gyroscope's scale and misalignment, a latent torque that no effect explains; then the path's predicted
rate, the inertia, a wheel's axis and the path itself move to what was found. The sizes of what is flexible come by
evidence, so hypotheses compare by their marginal likelihoods.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.correlated_errors import innovations, log_density
from massprops.diagnosis.criteria import AXIS_SD, CLOCK_SD, LEAST_SHARE, OFFSET_SD, SCALE_SD, SHAPE_SD, WIDE
from massprops.diagnosis.effect_columns import Term, forcing_of
from massprops.diagnosis.evidence import Block, Posterior, solve
from massprops.diagnosis.latent_torque import by_direction, factor, hats, matern, three_axes
from massprops.diagnosis.momentum_balance import (
    INERTIA,
    Balance,
    Forcing,
    inertia_of,
    shape_of,
    torque_forcing,
)
from massprops.diagnosis.record import Record, along, attitudes_of, in_turned_axes
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.errors import NotPossible

PASSES = 12
SETTLED = 0.2
"""Change of the log evidence between two passes at which they end, and gain of it that is left to a step of the inertia: it
decides nothing."""
SMALL_STEP = 0.02
"""Of the inertia's shape, which ends the passes too: the next one is about its square."""
SMALLEST = 0.01
"""Of the usual start of the search for a size: from less it takes long to come back."""
LARGEST_STEP = 1.0
"""Of the inertia's shape in a pass: a factor of e in a second moment of mass."""
SMALL_MOMENT = 1e-4
"""Over the mean one, by which the inertia's shape is differentiated."""
TORQUE_KNOTS = 40
TORQUE_LENGTH = 0.05
"""Length of the latent torque over the record's. Longer ones let it stand for the slow part of a wheel's history: on the
odd flights .25 and .1 found wheels a fifth smaller than .04 did, and .04 had the higher evidence or the same."""
AXES = "sensors' axes"
"""Name of the unknowns of their turn in the body."""
WALK_STEPS = 10
"""In which the turn of a path by the noise of the rates that it is integrated from is drawn: a random walk."""
DIRECTIONS = 150
"""Of the Sun along the path, at which a torque that depends on them is known."""
START_SD = 0.1
"""Scale of the law of a wheel's momentum at the start over the body's: Cauchy's, as it may stand still or turn with much. It is no step
of the drive, from whose law it was once drawn, by which a wheel that stands still was likelier by 6 (Basilisk, seed 58). With 0.03 the
histories of Basilisk's seeds 60 and 61 are off by 2.6 and 3.2 sigmas, with 0.1 by 1.5 and 2.4, with 1 by 1.2 and 1.9; one of the flights,
whose wheel stands still, has ratios of inertia that are off by 2.9 % with 0.03, 3.1 with 0.1 and 3.2 with 1."""
WHEEL_KNOTS, WHEEL_KNOTS_OF_RATES = 60, 120
"""Most of a wheel's history, and no more than half the rows: its heavy-tailed steps let go of those not asked for. Rates show a drive
from one row to the next: in seven flights log evidence rose by 3 to 84 from 60 knots to 120, and 150 were as likely."""


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """What acts.

    Attributes:
        terms: effects; wheel: a wheel of any history along one axis beside them; lag: time constant [s] with which that
            wheel follows its drive, a motor or a brake; latent: whether a latent torque acts, smooth in body axes; inertial: whether
            one acts that is smooth in inertial axes; by_sun: whether one acts that depends on the Sun's direction in the body in any
            way. scale: prior 1-sigma of a gyroscope's scale and misalignment;
            memory: time constant of the attitudes' errors [s] (`correlated_errors`), 0 of independent ones.
    """

    terms: tuple[Term, ...] = ()
    wheel: bool = False
    lag: float = 0.0
    latent: bool = True
    inertial: bool = False
    by_sun: bool = False
    scale: float = SCALE_SD
    memory: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects in it."""
        return (("internal-rotor",) if self.wheel else ()) + tuple(t.name for t in self.terms)

    @property
    def linear(self) -> bool:
        """Whether all enters linearly but the inertia (a wheel's axis by a small turn): what an effect's own values move by does not."""
        return not any(t.moves for t in self.terms)

    def term(self, name: str) -> Term:
        """The effect of that name."""
        return next(t for t in self.terms if t.name == name)


@dataclass(frozen=True, kw_only=True)
class HypothesisFit:
    """A fitted hypothesis; n points of the path, m rows.

    Attributes:
        record: with the path at the end; shape: (5,) of the inertia; inertia: (3, 3), trace 3; momentum: (3,) at the start, inertial axes.
        evidence: log marginal likelihood; noise: (g,) factors on the rows' noise (`Rows.groups`); posterior: of all unknowns.
        values: by effect, its unknowns; covariance: theirs.
        axis, history, history_sd: of a wheel: (3,), (n,) and (n,) [rad/s], or None.
        torque: (n, 3) latent, body axes [rad/s^2]; left: (all, 3) what the rows hold beyond the model without the latent
            torque, over their noise; residual: (all, 3) with it. rate: (n, 3) predicted.
        held_sd: by effect, 1-sigma of the values that its columns hold, where they were looked at (`scanned_values`).
        carried: (n, 3) angular momentum of all, body axes [rad/s].
        widened: by how much sigmas are larger than independent rows would have them, in `covariance` already.
        settled: whether the passes came to rest. Where they did not, covariances hold the step that was left. unverified: log
            evidence that the last pass expects of its step of the inertia, along which no pass has seen the balance.
    """

    hypothesis: Hypothesis
    record: Record
    shape: np.ndarray
    inertia: np.ndarray
    momentum: np.ndarray
    evidence: float
    noise: np.ndarray
    posterior: Posterior
    values: dict[str, np.ndarray]
    covariance: dict[str, np.ndarray]
    axis: np.ndarray | None
    history: np.ndarray | None
    history_sd: np.ndarray | None
    torque: np.ndarray
    left: np.ndarray
    residual: np.ndarray
    rate: np.ndarray
    carried: np.ndarray
    blocks: tuple[Block, ...]
    y: np.ndarray
    held_sd: dict[str, dict[str, float]] = field(default_factory=dict)
    widened: float = 1.0
    settled: bool = False
    unverified: float = 0.0

    @property
    def verified(self) -> float:
        """Log evidence less what is unverified where the passes did not come to rest (where they did, the next step is about the square
        of the last): fits of one hypothesis from several starts compare by it."""
        return self.evidence if self.settled else self.evidence - self.unverified

    @property
    def names(self) -> tuple[str, ...]:
        return self.hypothesis.names

    @property
    def row_noise(self) -> np.ndarray:
        """(3 all,) factor on the noise of each number measured."""
        return np.asarray(self.noise[self.record.rows.groups])


@dataclass(frozen=True, kw_only=True)
class AxesTurn:
    """How the axes of a record's sensors are turned in those of the body: about `at` (3,) [rad], by a law of zero mean and of 1-sigma
    `sd` for each axis [rad]."""

    at: np.ndarray
    sd: float


@dataclass(frozen=True, kw_only=True)
class _Guess:
    """Where a pass is linearised: see `HypothesisFit`.

    Attributes:
        axes: turn of the sensors' axes, of which the record has been turned back by as much, or None where that is no unknown.
        sizes: by block, prior standard deviation that the pass before found for unknowns of one size; noise: (g,) its factors.
    """

    shape: np.ndarray
    rate: np.ndarray
    momentum: np.ndarray
    start: np.ndarray
    axis: np.ndarray | None
    history: np.ndarray | None
    sizes: dict[str, float] = field(default_factory=dict)
    noise: np.ndarray | None = None
    axes: AxesTurn | None = None


@dataclass(frozen=True, kw_only=True)
class _Solution:
    """What a pass found about a guess, before anything moves.

    Attributes:
        acting: the columns of each effect; parts: see `_parts`; blocks, y: the linear model; posterior: its solution.
    """

    record: Record
    hypothesis: Hypothesis
    guess: _Guess
    balance: Balance
    acting: dict[str, Forcing]
    parts: list[Any]
    blocks: list[Block]
    y: np.ndarray
    posterior: Posterior

    @cached_property
    def bent(self) -> tuple[np.ndarray, np.ndarray]:
        """(f,) places among all unknowns of those that do not enter linearly, the inertia's shape first, and (f,) where the guess has
        them."""
        ends = dict(zip(self.posterior.mean, np.cumsum([b.count for b in self.blocks]), strict=True))
        at, here = [np.arange(INERTIA)], [self.guess.shape]
        for term in self.hypothesis.terms:
            count = len(self.posterior.mean[term.name])
            own = term.here(count)
            if own is not None:
                at.append(np.arange(ends[term.name] - count, ends[term.name]))
                here.append(own)
        return np.concatenate(at), np.concatenate(here)

    @cached_property
    def step(self) -> np.ndarray:
        """(f,) of what does not enter linearly to its likeliest."""
        at, here = self.bent
        return np.asarray(np.concatenate(list(self.posterior.mean.values()))[at] - here)

    @property
    def largest(self) -> float:
        """Of the step of the inertia's shape."""
        return float(np.abs(self.step[:INERTIA]).max())

    @property
    def longest(self) -> float:
        """Part of the step that a pass may take."""
        return min(1.0, LARGEST_STEP / max(self.largest, 1e-12))

    @cached_property
    def gain(self) -> float:
        """Of the log evidence by that step, if the model is linear so far."""
        return 0.5 * self.posterior.square(self.step, self.bent[0])

    @cached_property
    def density(self) -> float:
        """Log density of the rows together with what does not enter linearly as the guess has it, over its prior's spread: what
        else is unknown is marginalised, the noise too (Student's law). It does not lean on how the rows answer to other values,
        so passes compare by it."""
        at = self.bent[0]
        sd = np.concatenate(list(self.posterior.sd.values()))[at]
        spread = self.posterior.joint[np.ix_(at, at)] / np.outer(sd, sd)
        return float(self.posterior.evidence - self.unverified - 0.5 * np.linalg.slogdet(2.0 * np.pi * spread)[1])

    @property
    def unverified(self) -> float:
        """Log evidence that the step gains if the model is linear so far, the noise marginalised."""
        count = len(self.y) + self.record.noise_rows
        return float(0.5 * count * np.log1p(2.0 * self.gain / count))

    def follows(self, before: _Solution, part: float) -> bool:
        """Whether the part of its step that the pass before took may stand: the measurements are hardly less likely after it, or it could
        gain so little that what they are less likely by is the path's, which the pass before had not reached. Passes with other
        unknowns do not compare. An effect's own values may cross a curved valley in long steps: they are asked within about a sigma
        of each unknown."""
        count = len(self.step)
        far = count > INERTIA and before.gain > count
        small = before.gain * part * (2.0 - part) < SETTLED
        return count != len(before.step) or far or small or self.density > before.density - SETTLED

    def near(self, before: _Solution) -> bool:
        """Whether nothing that decides is left to gain after the pass before."""
        small = self.gain < SETTLED or (len(self.step) == INERTIA and self.largest < SMALL_STEP)
        return small and abs(self.posterior.evidence - before.posterior.evidence) < SETTLED


def fit_hypothesis(record: Record, hypothesis: Hypothesis, start: Start, passes: int = PASSES) -> HypothesisFit:
    """The hypothesis at its most likely, from a start that it stays near.

    A record that hardly shows the inertia lets a step lead far beyond where the model is linear, to a needle or a plate, and a flat
    valley of an effect's own values lets it lead across: a step after which the measurements are less likely is taken back, and a
    part of it tried.

    Raises:
        NotPossible: the start leads nowhere.
    """
    guess = _first_guess(record, hypothesis, start)
    found: HypothesisFit | None = None
    best: _Solution | None = None
    damped = taken = 1.0
    # what is linearised about its own values takes about twice as many to its end
    for k in range(passes if hypothesis.linear or passes < PASSES else 2 * passes):
        before, settled = found, False
        # about rates as measured, noise stands in the columns of the inertia, and a wheel answers for it: first the motion alone
        motion = hypothesis.wheel and k == 0
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                own = _solved(record, hypothesis, guess)
                if best is None or own.follows(best, taken):
                    settled = best is not None and own.near(best)
                    best, damped = own, min(1.0, 2.0 * damped)
                else:
                    damped = 0.5 * min(best.longest, damped)
                taken = min(best.longest, damped)
                found, guess = _reached(best, 0.0 if motion else taken)
                best = None if motion else best
        except (np.linalg.LinAlgError, FloatingPointError):  # astray: the pass before is as far as it goes
            break
        if not (np.isfinite(found.evidence) and np.isfinite(found.rate).all()):
            found = before
            break
        record, hypothesis = found.record, _moved(found)
        if settled:
            return replace(found, settled=True)
    if found is None or best is None:
        raise NotPossible(
            "no rotation of a rigid body comes near this record, which may hold more than one body or flight: cut it to one"
        )
    return found if passes < PASSES else _widened(found, best)


def linearised(
    found: HypothesisFit,
    hypothesis: Hypothesis,
    shape: np.ndarray,
    axis: np.ndarray | None,
    axes: AxesTurn | None = None,
) -> HypothesisFit:
    """One pass along a fit's own path about another inertia's shape (5,), a wheel's axis (3,) and values that a hypothesis of the
    same effects holds: what the record says of all that several records share, near where these are. With `axes` the turn of the
    sensors' is one more unknown, and the fit is told in the body's axes.

    Raises:
        NotPossible: no body comes near the record there.
    """
    found = found if axes is None else _in_turned_axes(found, axes.at)
    path, sizes = (
        found.record.path,
        {b.name: float(found.posterior.sd[b.name][0]) for b in found.blocks if b.kind == "common"},
    )
    carried = found.carried + found.rate @ (inertia_of(shape) - found.inertia)
    other = axis is not None and found.axis is not None and axis @ found.axis < 0.0
    guess = _Guess(
        shape=shape, rate=found.rate, momentum=carried, axis=axis, sizes=sizes, noise=found.noise,
        history=-found.history if other and found.history is not None else found.history,
        start=np.mean(np.einsum("nij,nj->ni", path.R, carried), axis=0), axes=axes,
    )  # fmt: skip
    try:
        return replace(_reached(_solved(found.record, hypothesis, guess), 1.0)[0], widened=found.widened)
    except (np.linalg.LinAlgError, FloatingPointError):
        raise NotPossible("the records have no body in common that comes near them") from None


def _in_turned_axes(found: HypothesisFit, turn: np.ndarray) -> HypothesisFit:
    """A fit's motion and body in axes of which the record's are turned by `turn` (3,) [rad]."""
    C = rotation_matrix(from_rotation_vector(turn))
    return replace(
        found, record=in_turned_axes(found.record, turn), rate=found.rate @ C, carried=found.carried @ C,
        inertia=C.T @ found.inertia @ C, axis=None if found.axis is None else found.axis @ C,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """What a record says if the moment about a wheel's axis is another than a fit's.

    Attributes:
        density: log density of that moment and the rows; moment_sd: 1-sigma of the moment by this linearisation, over the mean one.
        history, history_sd: (n,) of the wheel; values, covariance: of each effect.
    """

    density: float
    moment_sd: float
    history: np.ndarray
    history_sd: np.ndarray
    values: dict[str, np.ndarray]
    covariance: dict[str, np.ndarray]


def along_wheel_axis(fit: HypothesisFit, added: float) -> Linearised:
    """What the record says of a wheel's fit with a moment `added` about its axis, by a pass about the inertia and the history that
    then move as the fit's do; all of the inertia but that moment is marginalised.

    Raises:
        NotPossible: no body has that moment, or none comes near the record with it.
    """
    axis, history, own = fit.axis, fit.history, fit.hypothesis
    assert axis is not None and history is not None

    def with_more(more: float) -> np.ndarray:
        more_inertia = fit.inertia + more * np.outer(axis, axis)
        return np.asarray(more_inertia * (3.0 / np.trace(more_inertia)))

    inertia, scale = with_more(added), 3.0 / (3.0 + added)
    if not np.linalg.eigvalsh(1.5 * np.eye(3) - inertia)[0] > LEAST_SHARE * 3.0:
        raise NotPossible("no body has that moment about the wheel's axis")
    shape = shape_of(inertia)
    carried = scale * fit.carried
    guess = _Guess(
        shape=shape, rate=fit.rate, momentum=carried, axis=axis, history=scale * (history - added * (fit.rate @ axis)),
        start=np.mean(np.einsum("nij,nj->ni", fit.record.path.R, carried), axis=0),
    )  # fmt: skip
    try:
        post = _solved(fit.record, own, guess).posterior
    except (np.linalg.LinAlgError, FloatingPointError):
        raise NotPossible("no body comes near the record with that moment about the wheel's axis") from None
    slope = (shape_of(with_more(added + SMALL_MOMENT)) - shape) / SMALL_MOMENT
    way = slope / (slope @ slope)
    off, across_all = float(way @ (post.mean["base"][:INERTIA] - shape)), post.joint[:, :INERTIA] @ way
    variance = float(way @ across_all[:INERTIA])
    mean = np.concatenate(list(post.mean.values())) - across_all * (off / variance)
    joint = post.joint - np.outer(across_all, across_all) / variance
    places = dict(zip(post.mean, _places(post), strict=True))
    shapes, wheel = _wheel_shapes(fit.record, own.lag), places["wheel"]
    spread = np.sum((shapes @ joint[wheel, wheel]) * shapes, axis=1)
    told = {t.name: t.values(mean[places[t.name]], joint[places[t.name], places[t.name]]) for t in own.terms}
    return Linearised(
        density=float(post.evidence - 0.5 * (off**2 / variance + np.log(2.0 * np.pi * variance))),
        moment_sd=float(np.sqrt(variance)), history=shapes @ mean[wheel], history_sd=np.sqrt(np.maximum(spread, 0.0)),
        values={k: v for k, (v, _) in told.items()}, covariance={k: c for k, (_, c) in told.items()},
    )  # fmt: skip


def _places(post: Posterior) -> list[slice]:
    """Where each block's unknowns stand among all."""
    ends = np.cumsum([0, *map(len, post.mean.values())]).tolist()
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]


def _first_guess(record: Record, hypothesis: Hypothesis, start: Start) -> _Guess:
    path = record.path
    axis, history = (start.axis, start.history) if hypothesis.wheel else (None, None)
    inside = np.zeros_like(path.w) if axis is None or history is None else history[:, None] * axis
    momentum = path.w @ inertia_of(shape_of(start.inertia)) + inside
    return _Guess(
        shape=shape_of(start.inertia), rate=path.w, momentum=momentum, axis=axis, history=history,
        start=np.mean(np.einsum("nij,nj->ni", path.R, momentum), axis=0),
    )  # fmt: skip


def _moved(found: HypothesisFit) -> Hypothesis:
    """The hypothesis about the values that a pass led to, for effects that are not linear in theirs."""
    own = found.hypothesis
    return replace(own, terms=tuple(t.moved(found.posterior.mean[t.name]) if t.moves else t for t in own.terms))


def _widened(found: HypothesisFit, last: _Solution) -> HypothesisFit:
    """A fit that did not settle, with what its effects would move by with the step that was left in their covariance."""
    shift, post = last.posterior.shifts(last.step, last.bent[0]), found.posterior
    covariance = dict(post.covariance)
    for term in found.hypothesis.terms:
        covariance[term.name] = covariance[term.name] + np.outer(shift[term.name], shift[term.name])
    own = {t.name: t.values(post.mean[t.name], covariance[t.name])[1] for t in found.hypothesis.terms}
    return replace(found, posterior=replace(post, covariance=covariance), covariance=own)


def _solved(record: Record, hypothesis: Hypothesis, guess: _Guess) -> _Solution:
    """All that enters linearly about a guess."""
    path, rows = record.path, record.rows
    balance = Balance(path=path, shape=guess.shape, momentum=guess.momentum, rate=guess.rate, rows=rows)
    acting = {
        t.name: forcing_of(t, path, guess.rate, balance.inertia, record.environment_state) for t in hypothesis.terms
    }
    parts = _parts(record, hypothesis, guess, balance, acting)
    blocks, y = _linear_model(record, hypothesis, parts, balance, guess)
    return _Solution(
        record=record, hypothesis=hypothesis, guess=guess, balance=balance, acting=acting, parts=parts, blocks=blocks, y=y,
        posterior=(_sized_at_guess if hypothesis.wheel else _sized)(record, guess, blocks, y),
    )  # fmt: skip


def _sized(record: Record, guess: _Guess, blocks: list[Block], y: np.ndarray) -> Posterior:
    """The solution with the sizes of what is flexible by evidence."""
    return solve(blocks, y, record.noise_rows, record.rows.groups, noise=guess.noise)


def _sized_at_guess(record: Record, guess: _Guess, blocks: list[Block], y: np.ndarray) -> Posterior:
    """The solution with the sizes that are likeliest at the guess's inertia.

    A wheel answers for the moment about its axis: sizes that are found together with a step of the inertia lead far beyond
    where the model is linear, where a wheel's steps explain noise.
    """
    base = blocks[0]
    held = Block(name=base.name, columns=base.columns[:, INERTIA:], sd=np.asarray(base.sd)[INERTIA:])
    sized = _sized(record, guess, [held, *blocks[1:]], y - base.columns[:, :INERTIA] @ guess.shape)
    own = [base, *(replace(b, sd=sized.sd[b.name]) for b in blocks[1:])]
    return solve(own, y, record.noise_rows, record.rows.groups, steps=1, noise=sized.noise)


def _reached(own: _Solution, part: float) -> tuple[HypothesisFit, _Guess]:
    """The fit after a part of the step of the inertia, all else as that inertia has it, and the next guess."""
    record, hypothesis, guess, balance = own.record, own.hypothesis, own.guess, own.balance
    path, rows = record.path, record.rows
    post = own.posterior if part == 1.0 else own.posterior.moved((part - 1.0) * own.step, own.bent[0], own.blocks)
    base = post.mean["base"]
    shape = guess.shape + part * own.step[:INERTIA]
    turn = None if rows.rates else base[INERTIA + 3 :]
    whole, phi = balance.motion(_rate_along(own.parts, post, balance, guess), turn)
    axis, history, history_sd = _wheel_found(record, hypothesis, guess, post)
    torque = np.zeros_like(path.w)
    latent = np.zeros(len(own.y))
    for name, shapes in _unknown_torques(record, hypothesis):
        torque = torque + shapes @ post.mean[name]
        latent = latent + next(b.columns for b in own.blocks if b.name == name) @ post.mean[name]
    summed = {t.name: t.values(post.mean[t.name], post.covariance[t.name]) for t in hypothesis.terms}
    moved = record if rows.rates else along(record, path.turned(phi, whole), attitudes_of(record))
    inside = np.zeros_like(whole) if axis is None or history is None else history[:, None] * axis
    for name, forcing in own.acting.items():
        if forcing.internal is not None:
            inside = inside + forcing.internal @ post.mean[name]
    found = HypothesisFit(
        hypothesis=hypothesis, record=moved, shape=shape, inertia=inertia_of(shape), momentum=guess.start + base[INERTIA : INERTIA + 3],
        evidence=post.evidence - float(np.sum(np.log(rows.spread))) + log_density(record, hypothesis.memory), noise=post.noise, posterior=post,
        values={k: v for k, (v, _) in summed.items()}, covariance={k: c for k, (_, c) in summed.items()},
        axis=axis, history=history, history_sd=history_sd, torque=torque,
        left=(post.residual + latent).reshape(-1, 3), residual=post.residual.reshape(-1, 3), rate=whole,
        carried=whole @ inertia_of(shape) + inside,
        blocks=tuple(own.blocks), y=own.y, unverified=own.unverified,
    )  # fmt: skip
    # beside a wheel's heavy-tailed steps the search for sizes has many ends: it begins anew with every pass
    kept = [] if hypothesis.wheel else [b.name for b in own.blocks if b.kind == "common"]
    return found, _Guess(
        shape=shape, rate=whole, momentum=found.carried, axis=axis, history=history, start=found.momentum,
        noise=None if hypothesis.wheel else post.noise, sizes={name: float(post.sd[name][0]) for name in kept},
    )  # fmt: skip


def _linear_model(
    record: Record, hypothesis: Hypothesis, parts: list[Any], balance: Balance, guess: _Guess
) -> tuple[list[Block], np.ndarray]:
    """The blocks of unknowns and the rows (r,) that they answer for, both over the noise.

    Raises:
        FloatingPointError: the predicted path leaves all bounds.
    """
    over = 1.0 / balance.rows.spread
    blocks = []
    for name, _, columns, sd, kind in parts:
        # the search for a size goes on where the pass before left it
        size = max(guess.sizes[name], SMALLEST * sd) if name in guess.sizes else sd
        own = innovations(columns.reshape(len(over), -1) * over[:, None], record, hypothesis.memory)
        blocks.append(Block(name=name, columns=own, sd=size, kind=kind, own=int(kind == "sparse")))
    if not all(np.isfinite(b.columns).all() for b in blocks):
        raise FloatingPointError("the path that is predicted leaves all bounds")
    y = innovations((balance.rows.values - balance.constant(guess.start)).reshape(-1) * over, record, hypothesis.memory)
    # the inertia's prior is about a ball, not about the present guess, and that of the sensors' axes about no turn
    y = y + blocks[0].columns[:, :INERTIA] @ guess.shape
    return blocks, y if guess.axes is None else y + next(b.columns for b in blocks if b.name == AXES) @ guess.axes.at


def _rate_along(parts: list[Any], post: Posterior, balance: Balance, guess: _Guess) -> np.ndarray:
    """(n, 3) rate along the path itself, of everything that was found."""
    base = post.mean["base"]
    shift = np.concatenate([base[:INERTIA] - guess.shape, base[INERTIA:]])
    rate = balance.rate_of(guess.start)[:, :, 0]
    for name, along_path, _, _, _ in parts:
        if along_path is not None:
            unknown = shift if name == "base" else post.mean[name]
            rate = rate + along_path @ unknown[: along_path.shape[2]]
    return np.asarray(rate)


def _wheel_found(
    record: Record, hypothesis: Hypothesis, guess: _Guess, post: Posterior
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
    """Axis (3,), history (n,) and its 1-sigma (n,) of a wheel; None of none."""
    if guess.axis is None:
        return None, guess.history, None
    shapes = _wheel_shapes(record, hypothesis.lag)
    variance = np.sum((shapes @ post.covariance["wheel"]) * shapes, axis=1)
    axis = guess.axis + across(guess.axis) @ post.mean["wheel axis"]
    return axis / np.linalg.norm(axis), shapes @ post.mean["wheel"], np.sqrt(np.maximum(variance, 0.0))


def _parts(
    record: Record, hypothesis: Hypothesis, guess: _Guess, balance: Balance, acting: dict[str, Forcing]
) -> list[Any]:
    """Name, rate along the path (n, 3, k) of a unit of each unknown, its rows, prior, and the prior's kind, by block."""
    path, speed = record.path, record.speed
    count = balance.base_count
    sd = np.concatenate([np.full(INERTIA, SHAPE_SD), np.full(3, WIDE * speed), np.full(count - INERTIA - 3, WIDE)])
    out: list[Any] = [("base", balance.free, balance.base(), sd, "fixed")]
    if record.rows.rates or record.rows.gyroscope is not None:
        columns = balance.sensor()
        out.append(("gyroscope", None, columns, sensor_sd(columns.shape[2], hypothesis.scale), "fixed"))
    if guess.axes is not None:
        out.append((AXES, None, balance.axes(), guess.axes.sd, "fixed"))
    if record.walk > 0.0:
        steps = hats(path.t, np.linspace(path.t[0], path.t[-1], WALK_STEPS + 1))[:, ::-1].cumsum(axis=1)[:, -2::-1]
        walk_sd = np.sqrt(record.walk * path.span / WALK_STEPS)
        out.append(("path's turn", None, balance.turned(three_axes(steps)), walk_sd, "fixed"))
    if guess.axis is not None and guess.history is not None:
        axis = guess.axis
        shapes = _wheel_shapes(record, hypothesis.lag)
        history = Forcing(internal=axis[:, None] * shapes[:, None, :])
        turned = Forcing(internal=guess.history[:, None, None] * across(axis))
        steps = np.concatenate([[START_SD * speed], np.full(shapes.shape[1] - 1, 1e-3 * speed)])
        out.append(("wheel", *_answers(balance, history), steps, "sparse"))
        out.append(("wheel axis", *_answers(balance, turned), AXIS_SD, "fixed"))
    for name, forcing in acting.items():
        known = hypothesis.term(name).sd
        size, kind = (_size(forcing, speed), "common") if known is None else (known, "fixed")
        out.append((name, *_answers(balance, forcing), size, kind))
    for name, shapes in _unknown_torques(record, hypothesis):
        out.append((name, *_answers(balance, torque_forcing(path, shapes)), 3e-3 * speed**2, "common"))
    return out


def sensor_sd(count: int, scale: float = SCALE_SD) -> np.ndarray:
    """(count,) prior of the columns of `Balance.sensor`; scale: of a gyroscope's scale and misalignment."""
    return np.array(([scale] * 9 + [OFFSET_SD] * 3 + [CLOCK_SD])[:count])


def _answers(balance: Balance, forcing: Forcing) -> tuple[np.ndarray, np.ndarray]:
    """Rate along the path itself (n, 3, k) and rows (m, 3, k) of a unit of each unknown."""
    along_path = balance.forced(forcing)
    return along_path, balance.response(along_path)


def _size(forcing: Forcing, speed: float) -> float:
    """Where the search for an effect's size begins: a twentieth of the body's momentum."""
    part = forcing.part
    assert part is not None
    return 0.05 * speed / max(float(np.sqrt(np.mean(part**2))), 1e-300)


def _wheel_shapes(record: Record, lag: float) -> np.ndarray:
    """(n, k) along the path: a constant, and the answer to a drive that rises from each knot to the next.

    A wheel on a motor or a brake follows its drive with one time constant, h' = (drive - h) / lag (a motor's torque
    falls with its speed), so few steps of the drive make the whole history. Without a lag it is the drive.
    """
    most = WHEEL_KNOTS_OF_RATES if record.rows.rates else WHEEL_KNOTS
    return _answers_to_drive(record.path.t.tobytes(), min(most, len(record.times) // 2), lag)


@lru_cache(maxsize=2)
def _answers_to_drive(times: bytes, knots: int, lag: float) -> np.ndarray:
    """As of `_wheel_shapes`: the passes of a fit ask for the same ones."""
    t = np.frombuffer(times)
    at = np.linspace(t[0], t[-1], knots)
    since = np.maximum(t[:, None] - at, 0.0)
    # the integral of the answer to a unit step
    reached = since - lag * -np.expm1(-since / lag) if lag > 0 else since
    rises = (reached[:, :-1] - reached[:, 1:]) / np.diff(at)
    return np.concatenate([np.ones((len(t), 1)), rises], axis=1)


def _unknown_torques(record: Record, hypothesis: Hypothesis) -> list[tuple[str, np.ndarray]]:
    """By name, (n, 3, 3 k) of each latent torque of unit size by unknowns that are independent of each other."""
    t, out = record.path.t, []
    if hypothesis.latent or hypothesis.inertial:
        knots = np.linspace(t[0], t[-1], TORQUE_KNOTS)
        smooth = three_axes(hats(t, knots) @ factor(matern(knots, TORQUE_LENGTH * (t[-1] - t[0]))))
        if hypothesis.latent:
            out.append(("latent torque", smooth))
        if hypothesis.inertial:
            out.append(("inertial torque", np.swapaxes(record.path.R, 1, 2) @ smooth))
    if hypothesis.by_sun:
        sun = record.sun
        knots = sun[np.unique(np.linspace(0, len(t) - 1, DIRECTIONS).astype(int))]
        out.append(("torque by the Sun", three_axes(by_direction(sun, knots))))
    return out


def torque_sd(fit: HypothesisFit) -> np.ndarray:
    """(n, 3) 1-sigma of a fit's latent torque along its path, body axes [rad/s^2]."""
    variance = np.zeros_like(fit.torque)
    for name, shapes in _unknown_torques(fit.record, fit.hypothesis):
        variance += np.sum((shapes @ fit.posterior.covariance[name]) * shapes, axis=2)
    return np.sqrt(np.maximum(variance, 0.0))


def across(axis: np.ndarray) -> np.ndarray:
    """(3, 2) two directions across an axis."""
    return np.linalg.svd(axis[None])[2][1:].T
