"""The parameters of a black box at which it explains a record best: least squares with finite differences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.core.levenberg_marquardt import Damping, descend
from massprops.diagnosis.black_box.worker import Simulator
from massprops.diagnosis.criteria import BLOCKS, FOLDS
from massprops.dynamics.quaternion import conjugate, multiply, normalise, rotation_vector
from massprops.errors import InputError, NotPossible
from massprops.model.problem import Problem

STEP = 1e-4
"""Of a finite difference, over the common size of a parameter; central, so errors are of its square."""
MOST_ITERATIONS, MOST_DAMPING = 30, 1e6
SETTLED = 1e-6
"""Relative fall of the cost at which the search ends."""
LEAST_SHOWN = 0.01
"""Change of all residuals together [sigma] by the common size of what is measured at all."""
SINGULAR, LOST = 1e-10, 1e-6
"""Of the largest eigenvalue of the normal equations: the error of finite differences; share of a parameter in what is not measured."""
FAINT, REAL = 10.0, 0.1
"""A derivative below the first [sigma over the common size] may be the simulator's own rounding: then a step of the common size moves
less than the second times as much."""
LARGEST = 1e3
"""Of a residual in sigmas: a trial that is this far off is far off."""


@dataclass(frozen=True)
class BlackBoxFit:
    """Attributes:
    values, sigma: (p,) parameters; residual: (r,) over the noise; held_out: root mean square of what blocks in time hold
        beyond the fit to the others; calls: of the simulator; failed: calls in which it gave nothing.
    """

    values: np.ndarray
    sigma: np.ndarray
    residual: np.ndarray
    held_out: float
    calls: int
    failed: int


class _Residuals:
    """Residuals over the noise as a function of the parameters in units of their common size."""

    def __init__(self, simulator: Simulator, problem: Problem) -> None:
        self.simulator, self.problem = simulator, problem
        self.start = np.array([q.start for q in simulator.parameters])
        self.size = np.array([q.size for q in simulator.parameters])
        self.calls = self.failed = 0
        self.epoch = np.zeros(0, int)
        self.why = ""

    def __call__(self, x: np.ndarray) -> np.ndarray | None:
        """(r,) or None where the simulator gives nothing."""
        self.calls += 1
        given = self.simulator(self.problem.times, self.start + self.size * x)
        if isinstance(given, str):
            self.failed, self.why = self.failed + 1, given
            return None
        return np.clip(self._rows(given), -LARGEST, LARGEST)

    def _rows(self, given: dict[str, np.ndarray]) -> np.ndarray:
        p, parts, epochs = self.problem, [], []

        def add(values: np.ndarray, there: np.ndarray) -> None:
            parts.append(values[there].ravel())
            epoch_numbers = np.arange(len(p.times)).reshape(-1, *[1] * (values.ndim - 1))
            epochs.append(np.broadcast_to(epoch_numbers, values.shape)[there].ravel())

        if "attitude" in given and p.has_attitude:
            turn = rotation_vector(multiply(conjugate(normalise(given["attitude"])), p.attitude))
            add(turn / p.sigma_attitude[:, None], np.isfinite(p.attitude[:, 0]) & (p.sigma_attitude > 0))
        if "rates" in given and p.has_rates:
            add((p.rates - given["rates"]) / p.sigma_rate, np.isfinite(p.rates[:, 0]))
        if "tracks" in given and p.has_tracks:
            if given["tracks"].shape != p.uv.shape:
                raise InputError(
                    f"--simulator {self.simulator.text}: tracks must be {p.uv.shape} here, not {given['tracks'].shape}"
                )
            off = (p.uv - given["tracks"]) / p.sigma_px[:, None, None]
            add(np.where(np.isfinite(off), off, LARGEST), p.seen)
        if not parts:
            raise InputError(
                f"--simulator {self.simulator.text}: it gives nothing that this sequence measures; it must give attitude, "
                "rates or tracks as the sequence does"
            )
        self.epoch = np.concatenate(epochs)
        return np.concatenate(parts)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """(r, p) by central differences, one-sided where one side gives nothing.

        Raises:
            NotPossible: neither side gives anything.
        """
        here, columns = None, []
        for k in range(len(x)):
            step = STEP * np.eye(len(x))[k]
            above, below = self(x + step), self(x - step)
            if above is not None and below is not None:
                columns.append(self._if_real(x, k, (above - below) / (2 * STEP)))
                continue
            here = self(x) if here is None else here
            side, sign = (above, 1.0) if above is not None else (below, -1.0)
            if side is None or here is None:
                name = self.simulator.parameters[k].name
                raise NotPossible(
                    f"--simulator {self.simulator.text}: it fails if {name} is changed a little either way: {self.why}"
                )
            columns.append(sign * (side - here) / STEP)
        return np.stack(columns, axis=1)

    def _if_real(self, x: np.ndarray, k: int, column: np.ndarray) -> np.ndarray:
        """A derivative (r,), or nothing where it is rounding that a longer step does not show."""
        size = float(np.linalg.norm(column))
        if not 0.0 < size < FAINT:
            return column
        far = np.eye(len(x))[k]
        above, below = self(x + far), self(x - far)
        if above is None or below is None or np.linalg.norm(above - below) >= 2 * REAL * size:
            return column
        return np.zeros_like(column)


def fit_black_box(simulator: Simulator, problem: Problem) -> BlackBoxFit:
    """The fit of all measurements that the simulator gives, begun at its own start.

    Raises:
        NotPossible: it fails at its start, or all about a point; it does not answer.
        InputError: it gives nothing that was measured.
    """
    rows = _Residuals(simulator, problem)
    x, r, J = _least(rows, np.zeros(len(rows.start)), MOST_ITERATIONS)
    sigma = _sigma(J, max(1.0, float(r @ r) / max(1, len(r) - len(x))))
    n = len(problem.times)
    fold = np.minimum(rows.epoch * BLOCKS // n, BLOCKS - 1) % FOLDS
    held = np.empty(len(r))
    for k in range(FOLDS):
        # about the whole record's answer the fit without a fold is one linear step away
        A, b = J[fold != k], r[fold != k]
        held[fold == k] = r[fold == k] - J[fold == k] @ np.linalg.lstsq(A, b, rcond=1e-10)[0]
    return BlackBoxFit(
        rows.start + rows.size * x, rows.size * sigma, r, float(np.sqrt(np.mean(held**2))), rows.calls, rows.failed
    )


def _sigma(J: np.ndarray, inflation: float) -> np.ndarray:
    """(p,) 1-sigma from the derivatives (r, p) of the residuals; infinite for a parameter that moves along a way on which nothing changes."""
    value, vector = np.linalg.eigh(J.T @ J)
    known = value > max(LEAST_SHOWN**2, SINGULAR * float(value[-1]))
    variance = np.sum(vector[:, known] ** 2 / value[known], axis=1) * inflation
    lost = np.sum(vector[:, ~known] ** 2, axis=1) > LOST
    return np.where(lost, np.inf, np.sqrt(variance))


Place = tuple[np.ndarray, np.ndarray]
"""Parameters (p,) and the residuals (r,) that they leave."""


def _least(rows: _Residuals, x: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters, residuals (r,) and their last derivatives (r, p) at the least cost near a start."""
    r = rows(x)
    if r is None:
        raise NotPossible(f"--simulator {rows.simulator.text}: it fails with its own start values: {rows.why}")
    J = np.zeros((len(r), len(x)))

    def linearise(at: Place) -> tuple[float, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        nonlocal J
        J = rows.jacobian(at[0])
        H = J.T @ J
        scale = np.maximum(np.diag(H), 1e-12 * float(np.max(np.diag(H)) or 1.0))
        return float(at[1] @ at[1]), (H, np.diag(scale), J.T @ at[1])

    def step(at: Place, equations: tuple[np.ndarray, np.ndarray, np.ndarray], damping: float) -> tuple[float, Place]:
        H, scale, g = equations
        trial = at[0] - np.linalg.solve(H + damping * scale, g)
        after = rows(trial)
        return (np.inf, at) if after is None else (float(after @ after), (trial, after))

    for descent in descend((x, r), linearise, step, most, Damping(most=MOST_DAMPING)):
        x, r = descent.place
        if descent.fall < SETTLED * (descent.cost + descent.fall):
            break
    return x, r, J


def document_of_black_box(simulator: Simulator, fit: BlackBoxFit) -> dict[str, Any]:
    """`simulator` in `diagnosis.json`."""
    return {
        "name": simulator.text,
        "parameters": {
            q.name: float(v) if np.isfinite(s) else None
            for q, v, s in zip(simulator.parameters, fit.values, fit.sigma, strict=True)
        },
        "sigma": {
            q.name: float(s) if np.isfinite(s) else None for q, s in zip(simulator.parameters, fit.sigma, strict=True)
        },
        "units": {q.name: q.unit for q in simulator.parameters},
        "fitted": float(np.sqrt(np.mean(fit.residual**2))),
        "held_out": fit.held_out,
        "calls": fit.calls,
        "failed": fit.failed,
    }
