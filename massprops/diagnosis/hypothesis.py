"""What acts in a hypothesis, and the columns of its unknowns in the balance of momentum, about a guess."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from massprops.diagnosis.correlated_errors import innovations
from massprops.diagnosis.criteria import AXIS_SD, CLOCK_SD, OFFSET_SD, SCALE_SD, SHAPE_SD, WIDE
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.evidence import Block
from massprops.diagnosis.latent_torque import by_direction, factor, hats, matern, three_axes
from massprops.diagnosis.momentum_balance import INERTIA, Balance, Forcing, torque_forcing
from massprops.diagnosis.record import Record

SMALLEST = 0.01
"""Of the usual start of the search for a size: from less it takes long to come back."""
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
class AxesTurn:
    """How the axes of a record's sensors are turned in those of the body: about `at` (3,) [rad], by a law of zero mean and of 1-sigma
    `sd` for each axis [rad]."""

    at: np.ndarray
    sd: float


@dataclass(frozen=True, kw_only=True)
class Guess:
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


def linear_model(
    record: Record, hypothesis: Hypothesis, parts: list[Any], balance: Balance, guess: Guess
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
        whitened = innovations(columns.reshape(len(over), -1) * over[:, None], record, hypothesis.memory)
        blocks.append(Block(name=name, columns=whitened, sd=size, kind=kind, own=int(kind == "sparse")))
    if not all(np.isfinite(b.columns).all() for b in blocks):
        raise FloatingPointError("the path that is predicted leaves all bounds")
    y = innovations((balance.rows.values - balance.constant(guess.start)).reshape(-1) * over, record, hypothesis.memory)
    # the inertia's prior is about a ball, not about the present guess, and that of the sensors' axes about no turn
    y = y + blocks[0].columns[:, :INERTIA] @ guess.shape
    return blocks, y if guess.axes is None else y + next(b.columns for b in blocks if b.name == AXES) @ guess.axes.at


def parts_of(
    record: Record, hypothesis: Hypothesis, guess: Guess, balance: Balance, active: dict[str, Forcing]
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
        shapes = wheel_shapes(record, hypothesis.lag)
        history = Forcing(internal=axis[:, None] * shapes[:, None, :])
        turned = Forcing(internal=guess.history[:, None, None] * across(axis))
        steps = np.concatenate([[START_SD * speed], np.full(shapes.shape[1] - 1, 1e-3 * speed)])
        out.append(("wheel", *_answers(balance, history), steps, "sparse"))
        out.append(("wheel axis", *_answers(balance, turned), AXIS_SD, "fixed"))
    for name, forcing in active.items():
        known = hypothesis.term(name).sd
        size, kind = (_size(forcing, speed), "common") if known is None else (known, "fixed")
        out.append((name, *_answers(balance, forcing), size, kind))
    for name, shapes in unknown_torques(record, hypothesis):
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


def wheel_shapes(record: Record, lag: float) -> np.ndarray:
    """(n, k) along the path: a constant, and the answer to a drive that rises from each knot to the next.

    A wheel on a motor or a brake follows its drive with one time constant, h' = (drive - h) / lag (a motor's torque
    falls with its speed), so few steps of the drive make the whole history. Without a lag it is the drive.
    """
    most = WHEEL_KNOTS_OF_RATES if record.rows.rates else WHEEL_KNOTS
    return _answers_to_drive(record.path.t.tobytes(), min(most, len(record.times) // 2), lag)


@lru_cache(maxsize=2)
def _answers_to_drive(times: bytes, knots: int, lag: float) -> np.ndarray:
    """As of `wheel_shapes`: the passes of a fit ask for the same ones."""
    t = np.frombuffer(times)
    at = np.linspace(t[0], t[-1], knots)
    since = np.maximum(t[:, None] - at, 0.0)
    # the integral of the answer to a unit step
    reached = since - lag * -np.expm1(-since / lag) if lag > 0 else since
    rises = (reached[:, :-1] - reached[:, 1:]) / np.diff(at)
    return np.concatenate([np.ones((len(t), 1)), rises], axis=1)


def unknown_torques(record: Record, hypothesis: Hypothesis) -> list[tuple[str, np.ndarray]]:
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


def across(axis: np.ndarray) -> np.ndarray:
    """(3, 2) two directions across an axis."""
    return np.linalg.svd(axis[None])[2][1:].T
