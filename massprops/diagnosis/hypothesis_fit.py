"""One hypothesis fitted to a record by Gauss and Newton's method on the balance of momentum.

Each pass solves for everything that enters linearly: the inertia about the present one, momentum (and turn) at the start,
the effects, the gyroscope's scale and misalignment, a latent torque that no effect explains; then the path's predicted
rate, the inertia, a wheel's axis and the path itself move to what was found. The sizes of what is flexible come by
evidence, so hypotheses compare by their marginal likelihoods.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.correlated_errors import log_density
from massprops.diagnosis.effect_columns import forcing_of
from massprops.diagnosis.evidence import Block, Posterior, solve
from massprops.diagnosis.hypothesis import (
    AxesTurn,
    Guess,
    Hypothesis,
    across,
    linear_model,
    parts_of,
    unknown_torques,
    wheel_shapes,
)
from massprops.diagnosis.momentum_balance import INERTIA, Balance, Forcing, inertia_of, shape_of
from massprops.diagnosis.record import Record, along, attitudes_of, in_turned_axes
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.errors import NotPossible

PASSES = 12
"""At most."""
SETTLED = 0.2
"""Change of the log evidence between two passes at which they end, and gain of it that is left to a step of the inertia: it
decides nothing."""
SMALL_STEP = 0.02
"""Of the inertia's shape, which ends the passes too: the next one is about its square."""
LARGEST_STEP = 1.0
"""Of the inertia's shape in a pass: a factor of e in a second moment of mass."""


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
class _Solution:
    """What a pass found about a guess, before anything moves.

    Attributes:
        active: the columns of each effect; parts: see `hypothesis.parts_of`; blocks, y: the linear model; posterior: its solution.
    """

    record: Record
    hypothesis: Hypothesis
    guess: Guess
    balance: Balance
    active: dict[str, Forcing]
    parts: list[Any]
    blocks: list[Block]
    y: np.ndarray
    posterior: Posterior

    @cached_property
    def bent(self) -> tuple[np.ndarray, np.ndarray]:
        """(f,) places among all unknowns of those that do not enter linearly, the inertia's shape first, and (f,) where the guess has
        them."""
        places = self.posterior.places
        at, here = [np.arange(INERTIA)], [self.guess.shape]
        for term in self.hypothesis.terms:
            bend = term.here(len(self.posterior.mean[term.name]))
            if bend is not None:
                at.append(np.arange(places[term.name].start, places[term.name].stop))
                here.append(bend)
        return np.concatenate(at), np.concatenate(here)

    @cached_property
    def step(self) -> np.ndarray:
        """(f,) of what does not enter linearly to its likeliest."""
        at, here = self.bent
        return np.asarray(self.posterior.whole[at] - here)

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
    fit: HypothesisFit | None = None
    best: _Solution | None = None
    damped = taken = 1.0
    # what is linearised about its own values takes about twice as many to its end
    for k in range(passes if hypothesis.linear or passes < PASSES else 2 * passes):
        before, settled = fit, False
        # about rates as measured, noise stands in the columns of the inertia, and a wheel answers for it: first the motion alone
        motion = hypothesis.wheel and k == 0
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                solution = solved_about(record, hypothesis, guess)
                if best is None or solution.follows(best, taken):
                    settled = best is not None and solution.near(best)
                    best, damped = solution, min(1.0, 2.0 * damped)
                else:
                    damped = 0.5 * min(best.longest, damped)
                taken = min(best.longest, damped)
                fit, guess = _reached(best, 0.0 if motion else taken)
                best = None if motion else best
        except (np.linalg.LinAlgError, FloatingPointError):  # astray: the pass before is as far as it goes
            break
        if not (np.isfinite(fit.evidence) and np.isfinite(fit.rate).all()):
            fit = before
            break
        record, hypothesis = fit.record, _moved(fit)
        if settled:
            return replace(fit, settled=True)
    if fit is None or best is None:
        raise NotPossible(
            "no rotation of a rigid body comes near this record, which may hold more than one body or flight: cut it to one"
        )
    return fit if passes < PASSES else _widened(fit, best)


def linearised(
    fit: HypothesisFit,
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
    fit = fit if axes is None else _in_turned_axes(fit, axes.at)
    path, sizes = (
        fit.record.path,
        {b.name: float(fit.posterior.sd[b.name][0]) for b in fit.blocks if b.kind == "common"},
    )
    carried = fit.carried + fit.rate @ (inertia_of(shape) - fit.inertia)
    other = axis is not None and fit.axis is not None and axis @ fit.axis < 0.0
    guess = Guess(
        shape=shape, rate=fit.rate, momentum=carried, axis=axis, sizes=sizes, noise=fit.noise,
        history=-fit.history if other and fit.history is not None else fit.history,
        start=np.mean(np.einsum("nij,nj->ni", path.R, carried), axis=0), axes=axes,
    )  # fmt: skip
    try:
        return replace(_reached(solved_about(fit.record, hypothesis, guess), 1.0)[0], widened=fit.widened)
    except (np.linalg.LinAlgError, FloatingPointError):
        raise NotPossible("the records have no body in common that comes near them") from None


def _in_turned_axes(fit: HypothesisFit, turn: np.ndarray) -> HypothesisFit:
    """A fit's motion and body in axes of which the record's are turned by `turn` (3,) [rad]."""
    C = rotation_matrix(from_rotation_vector(turn))
    return replace(
        fit, record=in_turned_axes(fit.record, turn), rate=fit.rate @ C, carried=fit.carried @ C,
        inertia=C.T @ fit.inertia @ C, axis=None if fit.axis is None else fit.axis @ C,
    )  # fmt: skip


def _first_guess(record: Record, hypothesis: Hypothesis, start: Start) -> Guess:
    path = record.path
    axis, history = (start.axis, start.history) if hypothesis.wheel else (None, None)
    inside = np.zeros_like(path.w) if axis is None or history is None else history[:, None] * axis
    momentum = path.w @ inertia_of(shape_of(start.inertia)) + inside
    return Guess(
        shape=shape_of(start.inertia), rate=path.w, momentum=momentum, axis=axis, history=history,
        start=np.mean(np.einsum("nij,nj->ni", path.R, momentum), axis=0),
    )  # fmt: skip


def _moved(fit: HypothesisFit) -> Hypothesis:
    """The hypothesis about the values that a pass led to, for effects that are not linear in theirs."""
    hypothesis = fit.hypothesis
    return replace(
        hypothesis, terms=tuple(t.moved(fit.posterior.mean[t.name]) if t.moves else t for t in hypothesis.terms)
    )


def _widened(fit: HypothesisFit, last: _Solution) -> HypothesisFit:
    """A fit that did not settle, with what its effects would move by with the step that was left in their covariance."""
    shift, post = last.posterior.shifts(last.step, last.bent[0]), fit.posterior
    covariance = dict(post.covariance)
    for term in fit.hypothesis.terms:
        covariance[term.name] = covariance[term.name] + np.outer(shift[term.name], shift[term.name])
    values = {t.name: t.values(post.mean[t.name], covariance[t.name])[1] for t in fit.hypothesis.terms}
    return replace(fit, posterior=replace(post, covariance=covariance), covariance=values)


def solved_about(record: Record, hypothesis: Hypothesis, guess: Guess) -> _Solution:
    """All that enters linearly about a guess."""
    path, rows = record.path, record.rows
    balance = Balance(path=path, shape=guess.shape, momentum=guess.momentum, rate=guess.rate, rows=rows)
    active = {
        t.name: forcing_of(t, path, guess.rate, balance.inertia, record.environment_state) for t in hypothesis.terms
    }
    parts = parts_of(record, hypothesis, guess, balance, active)
    blocks, y = linear_model(record, hypothesis, parts, balance, guess)
    return _Solution(
        record=record, hypothesis=hypothesis, guess=guess, balance=balance, active=active, parts=parts, blocks=blocks, y=y,
        posterior=(_sized_at_guess if hypothesis.wheel else _sized)(record, guess, blocks, y),
    )  # fmt: skip


def _sized(record: Record, guess: Guess, blocks: list[Block], y: np.ndarray) -> Posterior:
    """The solution with the sizes of what is flexible by evidence."""
    return solve(blocks, y, record.noise_rows, record.rows.groups, noise=guess.noise)


def _sized_at_guess(record: Record, guess: Guess, blocks: list[Block], y: np.ndarray) -> Posterior:
    """The solution with the sizes that are likeliest at the guess's inertia.

    A wheel answers for the moment about its axis: sizes that are found together with a step of the inertia lead far beyond
    where the model is linear, where a wheel's steps explain noise.
    """
    base = blocks[0]
    held = Block(name=base.name, columns=base.columns[:, INERTIA:], sd=np.asarray(base.sd)[INERTIA:])
    sized = _sized(record, guess, [held, *blocks[1:]], y - base.columns[:, :INERTIA] @ guess.shape)
    sized_blocks = [base, *(replace(b, sd=sized.sd[b.name]) for b in blocks[1:])]
    return solve(sized_blocks, y, record.noise_rows, record.rows.groups, steps=1, noise=sized.noise)


def _reached(solution: _Solution, part: float) -> tuple[HypothesisFit, Guess]:
    """The fit after a part of the step of the inertia, all else as that inertia has it, and the next guess."""
    record, hypothesis, guess, balance = solution.record, solution.hypothesis, solution.guess, solution.balance
    path, rows = record.path, record.rows
    post = (
        solution.posterior
        if part == 1.0
        else solution.posterior.moved((part - 1.0) * solution.step, solution.bent[0], solution.blocks)
    )
    base = post.mean["base"]
    shape = guess.shape + part * solution.step[:INERTIA]
    turn = None if rows.rates else base[INERTIA + 3 :]
    whole, phi = balance.motion(_rate_along(solution.parts, post, balance, guess), turn)
    axis, history, history_sd = _wheel_found(record, hypothesis, guess, post)
    torque = np.zeros_like(path.w)
    latent = np.zeros(len(solution.y))
    for name, shapes in unknown_torques(record, hypothesis):
        torque = torque + shapes @ post.mean[name]
        latent = latent + next(b.columns for b in solution.blocks if b.name == name) @ post.mean[name]
    summed = {t.name: t.values(post.mean[t.name], post.covariance[t.name]) for t in hypothesis.terms}
    moved = record if rows.rates else along(record, path.turned(phi, whole), attitudes_of(record))
    inside = np.zeros_like(whole) if axis is None or history is None else history[:, None] * axis
    for name, forcing in solution.active.items():
        if forcing.internal is not None:
            inside = inside + forcing.internal @ post.mean[name]
    fit = HypothesisFit(
        hypothesis=hypothesis, record=moved, shape=shape, inertia=inertia_of(shape), momentum=guess.start + base[INERTIA : INERTIA + 3],
        evidence=post.evidence - float(np.sum(np.log(rows.spread))) + log_density(record, hypothesis.memory), noise=post.noise, posterior=post,
        values={k: v for k, (v, _) in summed.items()}, covariance={k: c for k, (_, c) in summed.items()},
        axis=axis, history=history, history_sd=history_sd, torque=torque,
        left=(post.residual + latent).reshape(-1, 3), residual=post.residual.reshape(-1, 3), rate=whole,
        carried=whole @ inertia_of(shape) + inside,
        blocks=tuple(solution.blocks), y=solution.y, unverified=solution.unverified,
    )  # fmt: skip
    # beside a wheel's heavy-tailed steps the search for sizes has many ends: it begins anew with every pass
    kept = [] if hypothesis.wheel else [b.name for b in solution.blocks if b.kind == "common"]
    return fit, Guess(
        shape=shape, rate=whole, momentum=fit.carried, axis=axis, history=history, start=fit.momentum,
        noise=None if hypothesis.wheel else post.noise, sizes={name: float(post.sd[name][0]) for name in kept},
    )  # fmt: skip


def _rate_along(parts: list[Any], post: Posterior, balance: Balance, guess: Guess) -> np.ndarray:
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
    record: Record, hypothesis: Hypothesis, guess: Guess, post: Posterior
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
    """Axis (3,), history (n,) and its 1-sigma (n,) of a wheel; None of none."""
    if guess.axis is None:
        return None, guess.history, None
    shapes = wheel_shapes(record, hypothesis.lag)
    variance = np.sum((shapes @ post.covariance["wheel"]) * shapes, axis=1)
    axis = guess.axis + across(guess.axis) @ post.mean["wheel axis"]
    return axis / np.linalg.norm(axis), shapes @ post.mean["wheel"], np.sqrt(np.maximum(variance, 0.0))


def torque_sd(fit: HypothesisFit) -> np.ndarray:
    """(n, 3) 1-sigma of a fit's latent torque along its path, body axes [rad/s^2]."""
    variance = np.zeros_like(fit.torque)
    for name, shapes in unknown_torques(fit.record, fit.hypothesis):
        variance += np.sum((shapes @ fit.posterior.covariance[name]) * shapes, axis=2)
    return np.sqrt(np.maximum(variance, 0.0))
