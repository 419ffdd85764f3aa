"""One step, a record of steps, and their derivatives."""

import numpy as np
import pytest

from massprops.dynamics.runge_kutta import record, step, transition

A = np.array([[0.0, 1.0], [-2.0, -0.3]])


def slope(t, y):
    return A @ y + np.array([0.0, np.sin(t)])


def run(count):
    y, h = np.array([1.0, 0.5]), 2.0 / count
    for k in range(count):
        y = step(slope, k * h, y, h)
    return y


def test_order_is_four():
    exact = run(640)
    coarse, fine = (np.abs(run(n) - exact).max() for n in (20, 40))
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.1)


def test_a_record_is_its_steps_and_its_transitions_their_derivatives():
    size = np.array([0.1, 0.3, 0.2])
    start = np.concatenate([[0.0], np.cumsum(size)[:-1]])
    times = start[:, None] + np.array([0.0, 0.5, 0.5, 1.0]) * size[:, None]
    y0 = np.array([1.0, 0.5])
    states, stages = record(lambda k, i, y: list(slope(times[k, i], np.array(y))), list(y0), size)
    y = y0
    for k, h in enumerate(size):
        np.testing.assert_array_equal(stages[k, 0], y)
        y = step(slope, start[k], y, h)
        np.testing.assert_allclose(states[k + 1], y, rtol=1e-15)
    M = transition(np.broadcast_to(A, (3, 4, 2, 2)), size)
    moved, _ = record(lambda k, i, y: list(slope(times[k, i], np.array(y))), [2.0, 0.5], size)
    np.testing.assert_allclose((M[2] @ M[1] @ M[0])[:, 0], (moved - states)[-1], rtol=1e-13)
