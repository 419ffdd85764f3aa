"""A torque recovered without a model: its history, spectrum, frame, and what it goes along with."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.refit import FittedModel
from massprops.diagnosis.search.residual_statistics import mean_square
from massprops.dynamics.quaternion import rotate, rotation_matrix
from massprops.effects import Parameter
from massprops.estimators.batch.solve import InertiaPrior, Search, covariance_of, fit
from massprops.model import Model
from massprops.model.state import BODY_SIZE, INERTIA

MOST_KNOTS = 32
FEWEST_KNOTS = 4
WIDEST = 10.0
"""1-sigma of a torque over its largest value, above which nothing is said of it."""


def torque_effect(knots: np.ndarray) -> Any:
    """A body torque, linear between its values at `knots` (k,) [s]."""

    def torque(t: Any, q: Any, w: Any, p: Any, inertia: Any, environment: Any) -> tuple[Any, Any, Any]:
        if isinstance(t, float):
            k = min(max(int(np.searchsorted(knots, t)) - 1, 0), len(knots) - 2)
            x = (t - knots[k]) / (knots[k + 1] - knots[k])
            return tuple((1 - x) * p[3 * k + a] + x * p[3 * k + 3 + a] for a in range(3))
        k = np.clip(np.searchsorted(knots, np.real(t)) - 1, 0, len(knots) - 2)
        x = (t - knots[k]) / (knots[k + 1] - knots[k])
        values = np.array(p).reshape(-1, 3)
        return tuple((1 - x) * values[k, a] + x * values[k + 1, a] for a in range(3))

    return SimpleNamespace(
        NAME="unknown-torque",
        SENTENCE="A torque recovered without a model.",
        PARAMETERS=tuple(Parameter(f"{a}_{i}", "rad s^-2", 1e-4) for i in range(len(knots)) for a in "xyz"),
        NEEDS=(),
        torque=torque,
        corners=lambda p: knots[1:-1],
    )


def recovered_torque(case: Case, base: FittedModel) -> dict[str, Any]:
    """The torque that would explain the base model's residuals.

    The inertia stays as the base model has it: a free torque could stand for any inertia.

    Returns:
        `times` (k,), `torque` (k, 3) body axes over the mean moment [rad/s^2], its `sigma`, `before`, `after` (rms over the noise),
        `frame` (body, space or neither), `period_s` of the strongest line, `correlations` with rate, Sun, field, nadir.
    """
    per_turn = max(4.0, 2 * np.pi / max(case.speed, 1e-12) / 6.0)
    count = int(np.clip(case.span / per_turn, 6, MOST_KNOTS))
    knots = np.linspace(case.problem.times[0], case.problem.times[-1], count)
    effect = torque_effect(knots)
    state = base.fit.state
    start = replace(state, model=Model((effect,), (np.zeros(3 * count),)))
    free = np.concatenate([case.first.free, np.ones(3 * count, bool)])
    free[INERTIA] = False
    fitted = fit(case.problem, case.fitted, start, case.environment, free, InertiaPrior(), Search(most=12))
    torque = fitted.state.model.values[0].reshape(-1, 3)
    usable = bool(np.isfinite(fitted.information).all())
    variance = (
        np.diag(covariance_of(fitted))[BODY_SIZE : BODY_SIZE + 3 * count] if usable else np.full(3 * count, np.inf)
    )
    sigma = np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 3)
    shown = sigma.max(axis=1) < WIDEST * max(float(np.abs(torque).max()), 1e-300)
    if shown.sum() >= FEWEST_KNOTS:  # beyond what was seen it may be anything
        knots, torque, sigma = knots[shown], torque[shown], sigma[shown]
    return {
        "times": knots,
        "torque": torque,
        "sigma": sigma,
        "before": base.fitted,
        "after": float(np.sqrt(mean_square(fitted.residuals))),
        **_character(case, fitted.predicted.q, fitted.predicted.motion.w, knots, torque),
    }


def _character(case: Case, q: np.ndarray, w: np.ndarray, knots: np.ndarray, torque: np.ndarray) -> dict[str, Any]:
    at = np.clip(np.searchsorted(case.problem.times, knots), 0, len(q) - 1)
    q, w = q[at], w[at]
    space = rotate(q, torque)
    power = float(np.sum(torque**2)) or 1.0
    in_body = len(torque) * float(np.sum(torque.mean(axis=0) ** 2)) / power
    in_space = len(torque) * float(np.sum(space.mean(axis=0) ** 2)) / power
    frame = "body" if in_body > max(0.5, in_space) else "space" if in_space > max(0.5, in_body) else "neither"
    x = torque - torque.mean(axis=0)
    spectrum = np.sum(np.abs(np.fft.rfft(x * np.hanning(len(x))[:, None], axis=0)) ** 2, axis=1)
    k = int(np.argmax(spectrum[1:])) + 1 if len(spectrum) > 1 else 0
    step = float(knots[1] - knots[0])
    period = len(knots) * step / k if k and spectrum[k] > 4 * np.median(spectrum[1:]) else None
    known = {"rate": w, **case.environment.known_in_body(knots, rotation_matrix(q))}
    correlations = {}
    for name, v in known.items():
        v = v / max(float(np.sqrt(np.mean(np.sum(v**2, axis=1)))), 1e-300)
        along = float(np.sum(torque * v)) / np.sqrt(power * float(np.sum(v**2)))
        across = float(np.mean(np.sum(torque * v, axis=1) ** 2) / max(np.mean(np.sum(torque**2, axis=1)), 1e-300))
        # a torque from a force along a direction stands across it: `across` is small then
        correlations[name] = {"along": along, "power_along": across}
    return {
        "frame": frame,
        "share_fixed_in_body": in_body,
        "share_fixed_in_space": in_space,
        "period_s": period,
        "correlations": correlations,
    }
