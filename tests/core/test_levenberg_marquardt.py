"""One search by damped steps for all callers."""

from __future__ import annotations

import numpy as np

from massprops.core.levenberg_marquardt import Damping, Step, damped_step, descend


def valley(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and derivatives of Rosenbrock's valley, least at (1, 1)."""
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def linearise(x: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
    r, J = valley(x)
    return float(r @ r), (J.T @ J, -J.T @ r)


def step(x: np.ndarray, equations: tuple[np.ndarray, np.ndarray], damping: float) -> tuple[float, np.ndarray]:
    new = x + damped_step(*equations, damping)
    return float(valley(new)[0] @ valley(new)[0]), new


def walked(most: int, damping: Damping) -> list[Step[np.ndarray]]:
    return list(descend(np.array([-1.2, 1.0]), linearise, step, most, damping))


def test_it_finds_the_bottom_of_a_bent_valley_and_ends_there() -> None:
    steps = walked(100, Damping())
    assert np.abs(steps[-1].place - 1.0).max() < 1e-12
    assert steps[-1].fall == 0.0 and len(steps) < 100


def test_each_step_lowers_the_cost_by_what_it_says() -> None:
    steps = walked(10, Damping())
    cost = [linearise(np.array([-1.2, 1.0]))[0], *(s.cost for s in steps)]
    assert [s.fall for s in steps] == [a - b for a, b in zip(cost, cost[1:], strict=False)]
    assert all(s.fall > 0 for s in steps) and len(steps) == 10


def test_damping_falls_to_its_least_and_failed_steps_are_counted() -> None:
    asked: list[float] = []

    def refused(x: np.ndarray, equations: object, damping: float) -> tuple[float, np.ndarray]:
        asked.append(damping)
        return np.nan, x

    begin = np.array([-1.2, 1.0])
    end = list(descend(begin, linearise, refused, 5, Damping(1.0, raised=2.0, tries=3)))
    assert asked == [1.0, 2.0, 4.0] and len(end) == 1 and end[0].place is begin and end[0].fall == 0.0
    asked.clear()
    list(descend(begin, linearise, refused, 5, Damping(1.0, raised=10.0, most=50.0)))
    assert asked == [1.0, 10.0]
    assert walked(30, Damping(1e-3, least=1e-5))[-1].damping >= 1e-5


def test_none_ends_the_search_at_once() -> None:
    calls: list[float] = []
    end = list(descend(np.zeros(2), linearise, lambda x, e, damping: calls.append(damping), 5))
    assert len(calls) == 1 and end[0].fall == 0.0


def test_a_step_without_damping_is_that_of_gauss_and_newton() -> None:
    r, J = valley(np.array([0.3, -0.4]))
    assert np.allclose(damped_step(J.T @ J, -J.T @ r, 0.0), np.linalg.lstsq(J, -r, rcond=None)[0])
    assert np.linalg.norm(damped_step(J.T @ J, -J.T @ r, 1e6)) < 1e-4
