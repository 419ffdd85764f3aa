"""What a diagnosis works on: the measurements, fitted and held out, the first guess, and what is believed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from massprops.dynamics.alignment import horn
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.quaternion import conjugate, multiply
from massprops.errors import NotPossible
from massprops.estimators.batch.solve import InertiaPrior
from massprops.estimators.batch.start import BatchStart, batch_start
from massprops.estimators.start import Start, first_guess
from massprops.model.measurements import Measurements, measurements_of
from massprops.model.problem import Problem
from massprops.model.state import in_axes
from massprops.sequence.data import AttitudeSeries

if TYPE_CHECKING:
    from massprops.diagnosis.candidate import Selection

BLOCKS = 20
HELD_BLOCKS = (5, 12, 18, 19)
"""Twentieths of the record that no fit sees: two inside, and the end, where a wrong model strays farthest."""
EVERY_FEATURE = 5
"""One feature in five is held out in the blocks of odd number, too."""
FEWEST_TO_HOLD = 60
"""Epochs below which nothing can be held out."""
ASSUMED_SIGMA = 0.02
"""Relative 1-sigma of an assumed inertia that states none."""
SCORED = 2500
"""Observations that are enough to order the candidates."""


@dataclass(frozen=True)
class Case:
    """One diagnosis.

    Attributes:
        fitted, held, scored: measurements that fits see, those they never see, and a part of the former for score tests.
        first: the first state; inertia_prior: about the inertia; there: what effects may need and is there.
        span: length of the record [s]; speed: typical angular velocity [rad/s].
        warnings: what was assumed. shown: attitudes as each epoch alone shows them, body axes of `first` to cam0, or None
            where nothing shows the one at the first epoch; balance: what their balance of momentum says (`by_balance`), once it
            was asked: the same on every path.
    """

    problem: Problem
    environment: EnvironmentModel
    first: BatchStart
    fitted: Measurements
    held: Measurements
    scored: Measurements
    inertia_prior: InertiaPrior
    there: frozenset[str]
    span: float
    speed: float
    warnings: tuple[str, ...]
    shown: AttitudeSeries | None = None
    balance: list[Selection | None] = field(default_factory=list, compare=False)


def case_of(problem: Problem, inflation: float = 1.0) -> Case:
    """Splits the record and finds the first state.

    Args:
        inflation: how many times the stated noise of tracks the first guess allows for: sensors that are wrong together
            otherwise look like outliers to it.

    Raises:
        NotPossible: no attitude or rates to begin with.
    """
    environment = EnvironmentModel(problem.environment, compiled=True)  # many fits are to come
    warnings = list(problem.warnings)
    guess = first_guess(replace(problem, sigma_px=inflation * problem.sigma_px))
    warnings += guess.warnings
    first = batch_start(problem, guess, environment, own_attitudes=problem.own_attitudes)
    warnings += first.notes
    inertia_prior = InertiaPrior()
    if problem.body is not None:
        body = problem.body
        sigma = body.inertia_sigma or ASSUMED_SIGMA
        if not body.inertia_sigma:
            warnings.append(f"body.yaml states no inertia_sigma: {100 * ASSUMED_SIGMA:g} % is assumed")
        assumed = 3.0 * body.inertia / np.trace(body.inertia)
        inertia_prior = InertiaPrior(assumed, max(sigma, 1e-5))
        if first.body_frame == "own" and not problem.has_rates:
            first = _in_body_axes(first, assumed)
    if len(problem.times) < FEWEST_TO_HOLD:
        warnings.append(
            f"{len(problem.times)} epochs are too few to hold any out, so no data test the prediction; a longer record would"
        )
    fitted, held, scored = _split(problem, first)
    if fitted.count < 30:
        raise NotPossible(
            f"{fitted.count} measurements are too few for a diagnosis, which needs 30: give a longer record"
        )
    return Case(
        problem=problem,
        environment=environment,
        first=first,
        fitted=fitted,
        held=held,
        scored=scored,
        inertia_prior=inertia_prior,
        there=frozenset(_there(problem, environment, first)),
        span=float(problem.times[-1]),
        speed=float(np.median(np.linalg.norm(guess.w, axis=1))),
        warnings=tuple(warnings),
        shown=_attitudes(problem, guess, first),
    )


def _attitudes(problem: Problem, guess: Start, first: BatchStart) -> AttitudeSeries | None:
    """What the first guess took each epoch's attitude for, in the axes of the first state: features tell how these lie."""
    poses = guess.poses
    if poses is None or poses.rows[0] != 0:
        return None
    q = poses.q
    if guess.features is not None and first.body_frame != "attitude0":
        both = np.isfinite(guess.features).all(axis=1) & np.isfinite(first.state.points).all(axis=1)
        turn, _ = horn(guess.features[both], first.state.points[both], np.ones(int(both.sum())))
        q = multiply(q, conjugate(turn))
    return AttitudeSeries(problem.stamp_ns[poses.rows], q, poses.sigma)


def _split(problem: Problem, first: BatchStart) -> tuple[Measurements, Measurements, Measurements]:
    """Measurements fitted, held out, and a part of the former for score tests."""
    n = len(problem.times)
    held_epochs = np.zeros(n, bool)
    held_tracks = np.zeros_like(problem.seen)
    if n >= FEWEST_TO_HOLD:
        block = np.minimum((np.arange(n) * BLOCKS) // n, BLOCKS - 1)
        held_epochs = np.isin(block, HELD_BLOCKS)
        held_tracks |= held_epochs[:, None, None]
        by_feature = np.arange(problem.seen.shape[2]) % EVERY_FEATURE == 2
        held_tracks |= (block % 2 == 1)[:, None, None] & by_feature[None, None, :]
    seen = first.observed
    fitted = measurements_of(problem, ~held_epochs, seen & ~held_tracks, first.channels)
    # a feature that no fitted observation places cannot be predicted
    placed = np.isin(np.arange(seen.shape[2]), np.unique(fitted.seen.feature))
    held = measurements_of(problem, held_epochs, seen & held_tracks & placed[None, None, :], first.channels)
    step = max(1, len(fitted.uv) // SCORED)
    keep = np.zeros_like(seen)
    keep[fitted.seen.epoch[::step], fitted.seen.camera[::step], fitted.seen.feature[::step]] = True
    scored = measurements_of(problem, ~held_epochs, keep, first.channels)
    return fitted, held, scored


def without_features(case: Case, wrong: np.ndarray) -> Case:
    """The case without some features (m,), with a warning that names them."""
    first = replace(case.first, observed=case.first.observed & ~wrong[None, None, :])
    fitted, held, scored = _split(case.problem, first)
    names = ", ".join(str(k) for k in case.problem.features[wrong])
    warning = f"features {names} do not move with the body and are left out"
    return replace(case, first=first, fitted=fitted, held=held, scored=scored, warnings=(*case.warnings, warning))


def _there(problem: Problem, environment: EnvironmentModel, first: BatchStart) -> set[str]:
    tracks = "tracks" in first.channels
    there = set(environment.known)
    for name, present in (
        ("tracks", tracks),
        ("stereo", tracks and problem.stereo),
        ("camera", tracks or "attitude" in first.channels),
        ("range", tracks and problem.has_range),
        ("assumed inertia", problem.body is not None),
    ):
        if present:
            there.add(name)
    return there


def _in_body_axes(first: BatchStart, assumed: np.ndarray) -> BatchStart:
    """The first state in the axes of `body.yaml`: principal axes matched by their moments, attitude free to move.

    Which of the four ways round does not matter: half turns about principal axes leave free rotation as it is.
    """
    _, axes = np.linalg.eigh(first.state.inertia)
    _, given = np.linalg.eigh(assumed)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    if np.linalg.det(given) < 0:
        given[:, 0] *= -1
    turned = replace(in_axes(first.state, given @ axes.T), inertia=assumed.copy())
    free = first.free.copy()
    free[:3] = True
    return replace(first, state=turned, free=free, body_frame="body.yaml")
