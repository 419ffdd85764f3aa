"""Torque-free motion fitted to the attitudes, or rates, of the first part of a record: where a filter can begin.

Local polynomials and conserved momentum begin the search; the fit then uses Euler's equations, so that it is as sharp
as the data, its covariance is that of the state together, and it holds where the body turns by a radian from one frame
to the next. The window grows from a few frames to the whole part, so that the phase is never lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.compiling import compiled
from massprops.core.levenberg_marquardt import Damping, damped_step, descend
from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.inertia import DIRECTIONS, project_to_physical
from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, normalise, rotation_vector
from massprops.estimators import free_path
from massprops.estimators.start import Start
from massprops.model.problem import Problem

FEWEST = 8
INERTIA_SIGMA = 0.15
"""1-sigma of the inertia's directions (trace 1) before the fit."""
LARGEST_TURN = 0.1
OUTLIER = 6.0
STEPS = 20
POOR = 3.0
"""Root mean square residual, in sigmas, of a fit that is not to be used."""


@dataclass(frozen=True)
class FreeFit:
    """A fit to epochs `rows` (k,).

    Attributes:
        q: (4,) body to cam0, w: (3,) [rad/s] at rows[0]. inertia: (3, 3) trace 1, body axes.
        covariance: (11, 11) of a small turn about body axes, of the rates, and of the inertia along `DIRECTIONS`.
        path: (k, 4) attitude in cam0.
    """

    rows: np.ndarray
    q: np.ndarray
    w: np.ndarray
    inertia: np.ndarray
    covariance: np.ndarray
    path: np.ndarray


def free_fit(problem: Problem, start: Start) -> FreeFit | None:
    """The fit to the start's span, in its body axes; None where there are too few epochs or the noise is not reached.

    Args:
        problem: the measurements. start: see `massprops.estimators.start`.
    """
    seen = _measured(problem, start)
    if seen is None or len(seen[0]) < FEWEST:
        return None
    rows, values, sigma = seen
    times = problem.times[rows]
    chaser = chaser_path(problem.environment, problem.times).q[rows]
    rates = values.shape[1] == 3
    if not rates:
        values = multiply(chaser, values)
    guesses = [_begin(times, values)]
    if start.inertia is not None and np.isfinite(start.w).all():
        near = int(np.argmin(np.abs(start.times - times[0])))
        q = np.array([1.0, 0, 0, 0]) if rates else multiply(chaser[0], start.q[near])
        guesses.insert(0, (q, start.w[near], start.inertia))
    best = None
    for number, guess in enumerate(guesses):
        grown = _grown(times, values, sigma, guess, len(times) if number == 0 and len(guesses) > 1 else FEWEST)
        if grown is not None and (best is None or grown[1] < best[1]):
            best = grown
        if best is not None and best[1] < POOR:
            break
    if best is None or best[1] > POOR:
        return None
    (q, w, inertia), _, covariance = best
    states = free_paths(times, [(q, w, inertia)])[0]
    back = conjugate(chaser)
    return FreeFit(rows, multiply(back[0], q), w, inertia, covariance, multiply(back, states[:, :4]))


Guess = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Attitude (4,) and body rates (3,) at the first epoch, and the inertia (3, 3) of trace 1."""
Found = tuple[Guess, float, np.ndarray]
"""With the root mean square residual and covariance (11, 11)."""


def fit_attitudes(times: np.ndarray, q: np.ndarray, sigma: np.ndarray, guess: Guess | None = None) -> Guess | None:
    """Free motion through all of an inertial attitude history; None where none is near it.

    Args:
        times: (n,) [s]; q: (n, 4) body to the inertial frame; sigma: (n,) [rad].
        guess: where to begin; without it the motion is followed from the first epochs on.
    """
    if len(times) < FEWEST:
        return None
    grown = _grown(times, q, sigma, guess or _begin(times, q), FEWEST if guess is None else len(times))
    return None if grown is None else grown[0]


def _begin(times: np.ndarray, values: np.ndarray) -> Guess:
    if values.shape[1] == 3:
        return np.array([1.0, 0, 0, 0]), values[0], np.eye(3) / 3.0
    turn = rotation_vector(multiply(conjugate(values[0]), values[1]))
    return values[0], turn / (times[1] - times[0]), np.eye(3) / 3.0


def _grown(times: np.ndarray, values: np.ndarray, sigma: np.ndarray, guess: Guess, count: int) -> Found | None:
    while True:
        fitted = _fitted(times[:count], values[:count], sigma[:count], guess)
        if fitted is None or count == len(times):
            return fitted
        guess = fitted[0]
        count = min(len(times), int(np.ceil(1.5 * count)))


def free_paths(times: np.ndarray, guesses: list[Guess]) -> list[np.ndarray]:
    """States (n, 7), attitude and body rates, of free motion at times (n,) from each guess at the first of them."""
    run = compiled("free_path", *free_path.COMPILED)
    out = []
    for q, w, I in guesses:
        six = np.array([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
        out.append(run(np.concatenate([q, w]), six, times, LARGEST_TURN))
    return out


def _residuals(times: np.ndarray, values: np.ndarray, guesses: list[Guess]) -> np.ndarray:
    """(guess, n, 3): measured minus motion."""
    states = np.array(free_paths(times, guesses))
    if values.shape[1] == 3:
        return values - states[:, :, 4:]
    return rotation_vector(multiply(conjugate(states[:, :, :4]), values))


def left_by(times: np.ndarray, values: np.ndarray, sigma: np.ndarray, guess: Guess) -> tuple[np.ndarray, np.ndarray]:
    """Measured minus motion (n, 3) in units of sigma (n,), and its derivatives (n, 3, 11) by the errors of `moved`."""
    speed = max(float(np.linalg.norm(guess[1])), 1e-9)
    h = np.array([1e-6] * 3 + [1e-6 * speed] * 3 + [1e-6] * 5)
    e = _residuals(times, values, [guess] + [moved(guess, x) for x in np.diag(h)])
    return e[0] / sigma[:, None], ((e[1:] - e[:1]) / h[:, None, None]).transpose(1, 2, 0) / sigma[:, None, None]


def _fitted(times: np.ndarray, values: np.ndarray, sigma: np.ndarray, guess: Guess) -> Found | None:
    """Least squares, derivatives by differences, outliers weighed down: guess, residual, covariance (11, 11)."""
    gauge = 1e12 if values.shape[1] == 3 else 0.0  # rates say nothing of the attitude
    prior = np.array([gauge] * 3 + [0.0] * 3 + [1.0 / INERTIA_SIGMA**2] * 5)
    weight, normal = np.ones(len(times)), np.eye(11)

    def linearise(at: Guess) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        nonlocal weight, normal
        r, J = left_by(times, values, sigma, at)
        length = np.linalg.norm(r, axis=1)
        weight = 1.0 / np.maximum(1.0, (length / max(OUTLIER, 2.0 * float(np.median(length)))) ** 2)
        normal = np.einsum("n,nia,nib->ab", weight, J, J) + np.diag(prior)
        side = -np.einsum("n,nia,ni->a", weight, J, r) - prior * _away(at)
        return _cost(r, weight, at, prior), (normal, side)

    def step(at: Guess, equations: tuple[np.ndarray, np.ndarray], damping: float) -> tuple[float, Guess]:
        q, w, inertia = moved(at, damped_step(*equations, damping))
        trial = q, w, project_to_physical(inertia)
        return _cost(_residuals(times, values, [trial])[0] / sigma[:, None], weight, trial, prior), trial

    for descent in descend(guess, linearise, step, STEPS, Damping(1e-4, lowered=8.0, least=1e-12, tries=8)):
        guess = descent.place
        if not np.isfinite(descent.cost):
            return None
        if descent.fall < 1e-7 * (descent.cost + descent.fall):
            break
    r = _residuals(times, values, [guess])[0] / sigma[:, None]
    scale = float(np.median(np.sum(r**2, axis=1))) / 2.366  # the median of chi-square with three degrees
    inverse = np.linalg.pinv(normal / np.outer(*[np.sqrt(np.diag(normal))] * 2), hermitian=True)
    covariance = inverse / np.outer(*[np.sqrt(np.diag(normal))] * 2) * max(scale, 1.0)
    return guess, float(np.sqrt(scale)), covariance


def moved(guess: Guess, x: np.ndarray) -> Guess:
    """A state after a step (11,): a small turn about body axes, a change of rates, and one of the inertia along `DIRECTIONS`."""
    q, w, inertia = guess
    turned = normalise(multiply(q, from_rotation_vector(x[:3])))
    return turned, w + x[3:6], inertia + np.einsum("a,aij->ij", x[6:], DIRECTIONS)


def _away(guess: Guess) -> np.ndarray:
    out = np.zeros(11)
    out[6:] = np.einsum("aij,ij->a", DIRECTIONS, guess[2] - np.eye(3) / 3.0)
    return out


def _cost(r: np.ndarray, weight: np.ndarray, guess: Guess, prior: np.ndarray) -> float:
    return float(np.sum(weight[:, None] * r**2) + np.sum(prior * _away(guess) ** 2))


def _measured(problem: Problem, start: Start) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Epochs (k,), attitudes (k, 4) as measured at each alone, or rates (k, 3), and their 1-sigma (k,)."""
    if start.poses is not None:
        return start.poses.rows, start.poses.q, _filled(start.poses.sigma)
    if problem.has_rates:
        there = (problem.times <= start.times[-1] + 1e-9) & (problem.times >= start.times[0] - 1e-9)
        rows = np.flatnonzero(there & np.isfinite(problem.rates).all(axis=1))
        return rows, problem.rates[rows], np.full(len(rows), max(problem.sigma_rate, 1e-12))
    return None


def _filled(sigma: np.ndarray) -> np.ndarray:
    ok = np.isfinite(sigma) & (sigma > 0)
    return np.where(ok, sigma, np.median(sigma[ok]) if ok.any() else 1e-3)
