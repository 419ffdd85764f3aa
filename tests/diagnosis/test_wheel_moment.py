"""The history of a wheel with sigmas that hold whatever the moment of inertia about its axis may be."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.evidence import Block, solve
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.wheel_moment import along_wheel_axis, with_open_moment

WITHIN = 2.5
"""Sigmas."""


@pytest.fixture(scope="module")
def wheel() -> tuple[HypothesisFit, np.ndarray, np.ndarray]:
    """A fit of a wheel that MuJoCo turns, its axis and true momentum (n,) over the body's mean moment."""
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import MUJOCO, _sequence, _world, moved

    rng = np.random.default_rng([30, list(MUJOCO).index("internal-rotor"), 103])
    world = _world(rng)
    acting = MUJOCO["internal-rotor"](rng, world)
    sequence = _sequence(*moved(world, [acting]), world.sun, rng)
    assert sequence.attitude is not None and acting.history is not None
    record, inertia = record_of_attitudes(sequence.attitude, sequence.environment), world.inertia
    reduced = 2.0 * 40.0 / 42.0
    at = np.array([0.2, -0.1, 0.15])
    moment = float(acting.history(np.array([0.0]))[0]) / 4.0
    whole = inertia + reduced * (at @ at * np.eye(3) - np.outer(at, at)) + moment * np.eye(3)
    mean = np.trace(whole) / 3.0
    history = acting.history(record.path.t) / mean
    start = Start(inertia=whole / mean, left=1.0, axis=acting.axis, history=history)
    fit = fit_hypothesis(record, Hypothesis(wheel=True, lag=45.0, latent=False), start)
    return fit, np.asarray(acting.axis), np.asarray(acting.history(fit.record.path.t) / mean)


def test_a_wheel_answers_for_the_moment_about_its_axis(wheel: tuple) -> None:
    fit, _, _ = wheel
    here, other = along_wheel_axis(fit, 0.0), along_wheel_axis(fit, 0.02)
    expected = (fit.history - 0.02 * (fit.rate @ fit.axis)) / (1.0 + 0.02 / 3.0)
    assert np.abs(other.history - expected).max() < 0.1 * np.abs(expected - fit.history).max()
    assert np.abs(here.history - fit.history).max() < 0.05 * np.ptp(fit.history)


def test_the_history_of_a_wheel_holds_whatever_that_moment_is(wheel: tuple) -> None:
    fit, axis, true = wheel
    own = with_open_moment(fit)
    off = np.abs(own.history * np.sign(fit.axis @ axis) - true)
    assert (own.history_sd > fit.history_sd).mean() > 0.9
    # it follows its corners less well
    assert (off < WITHIN * own.history_sd).mean() > 0.9
    assert np.array_equal(own.history, fit.history)


def test_what_a_wheel_begins_with_is_no_step() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((200, 12))
    y = 8.0 * columns[:, 0] + rng.standard_normal(200)
    block = Block(name="wheel", columns=columns, sd=np.append(3.0, np.full(11, 0.1)), kind="sparse", own=1)
    found = solve([block], y, 100.0)
    assert found.sd["wheel"][0] > 3.0 and found.sd["wheel"][1:].max() < 0.1
    together = solve([Block(name="wheel", columns=columns, sd=np.asarray(block.sd), kind="sparse")], y, 100.0)
    assert together.sd["wheel"][1:].max() > found.sd["wheel"][1:].max()  # the large one widens their law
    assert abs(found.mean["wheel"][0] - 8.0) < 0.3
