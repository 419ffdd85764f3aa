"""Errors of estimates against a simulated sequence's truth: for the page and the tables only, after the estimators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import (
    from_rotation_matrix,
    multiply,
    nearest_rotation,
    rotation_matrix,
    rotation_vector,
)
from massprops.estimators.result import Estimate
from massprops.mass.ratio_space import turn_between
from massprops.model.problem import Problem
from massprops.sequence.truth import Truth


@dataclass(frozen=True)
class Errors:
    """Estimate minus truth, n common epochs, in the truth's body axes.

    Attributes:
        times: (n,) [s].
        attitude: (n, 3) small turn, body axes [rad]; w: (n, 3) [rad/s]; position: (n, 3) in cam0 [m] or None.
        k: (2,) of the final ratios, None without; axes: [rad] between principal frames, modulo their symmetries.
        k_history: (n, 2) or None.
        at: (n,) index into the estimate's epochs.
        turn: (3, 3) estimate's body axes to the truth's.
    """

    times: np.ndarray
    attitude: np.ndarray
    w: np.ndarray
    position: np.ndarray | None
    k: np.ndarray | None
    axes: float | None
    k_history: np.ndarray | None
    at: np.ndarray
    turn: np.ndarray

    def summary(self) -> dict[str, Any]:
        """Root mean squares over the second half, and the final ratios' errors."""
        late = slice(len(self.times) // 2, None)

        def rms(values: np.ndarray | None) -> float | None:
            return None if values is None else float(np.sqrt(np.mean(np.sum(values[late] ** 2, axis=1))))

        return {
            "attitude_rms_rad": rms(self.attitude),
            "rate_rms_rad_s": rms(self.w),
            "position_rms_m": rms(self.position),
            "k1_error": None if self.k is None else float(self.k[0]),
            "k2_error": None if self.k is None else float(self.k[1]),
            "axes_error_deg": None if self.axes is None else float(np.degrees(self.axes)),
        }


def true_ratios(truth: Truth) -> np.ndarray | None:
    """(2,) k1, k2 that moved the body."""
    for prefix in ("motion_", ""):
        k = [truth.facts.get(f"{prefix}{name}") for name in ("k1", "k2")]
        if all(isinstance(v, int | float) for v in k):
            return np.array(k, float)
    inertia = true_inertia(truth)
    return None if inertia is None else ratios(inertia)[0]


def true_inertia(truth: Truth) -> np.ndarray | None:
    """(3, 3) that moved the body, in the truth's body axes."""
    for key in ("motion_inertia", "inertia"):
        try:
            inertia = np.array(truth.facts[key], float).reshape(3, 3)
        except (KeyError, TypeError, ValueError):
            continue
        if np.isfinite(inertia).all():
            return inertia
    return None


def errors(estimate: Estimate, problem: Problem, truth: Truth) -> Errors | None:
    """The estimate against the truth at common times; None when there are none.

    The truth's body axes are tied to those of `attitude0` by that series itself, and to an estimator's own axes by the
    mean turn between both attitudes over the second half, which is where a filter has settled.
    """
    if estimate.q is None or estimate.w is None or not len(truth.timestamp_ns):
        return None
    stamps = problem.stamps(estimate.times)
    _, at, there = np.intersect1d(stamps, truth.timestamp_ns, return_indices=True)
    finite = np.isfinite(estimate.q[at]).all(axis=1) & np.isfinite(estimate.w[at]).all(axis=1)
    at, there = at[finite], there[finite]
    if len(at) < 2:
        return None
    estimated, true = rotation_matrix(estimate.q[at]), rotation_matrix(truth.q[there])
    turn = None
    if estimate.body_frame == "attitude0":
        turn = attitude_turn(problem, truth)
    if turn is None:
        late = slice(len(at) // 2, None)
        turn = nearest_rotation((np.swapaxes(true[late], 1, 2) @ estimated[late]).sum(axis=0))
    carried = multiply(estimate.q[at], from_rotation_matrix(turn.T))
    apart = rotation_vector(multiply(truth.q[there] * [1, -1, -1, -1], carried))
    w = estimate.w[at] @ turn.T - truth.w[there]
    position = None
    if estimate.position is not None:
        centre = np.zeros(3)
        for key in ("motion_centre_of_mass_m", "centre_of_mass_m"):
            if truth.facts.get(key) is not None:
                centre = np.array(truth.facts[key], float)
                break
        position = estimate.position[at] - truth.position[there] - true @ centre
    k, inertia = true_ratios(truth), true_inertia(truth)
    k_error = axes = None
    if estimate.observable and estimate.k1 is not None and k is not None:
        k_error = np.array([estimate.k1, estimate.k2]) - k
    if estimate.observable and estimate.principal_axes is not None and inertia is not None:
        axes = float(np.linalg.norm(turn_between(turn @ estimate.principal_axes, ratios(inertia)[1])))
    history = None if estimate.k_history is None or k is None else estimate.k_history[at] - k
    return Errors(
        times=np.asarray(estimate.times)[at],
        attitude=apart,
        w=w,
        position=position,
        k=k_error,
        axes=axes,
        k_history=history,
        at=at,
        turn=turn,
    )


def attitude_turn(problem: Problem, truth: Truth) -> np.ndarray | None:
    """(3, 3) body axes of attitude0 to those of the truth."""
    _, at, there = np.intersect1d(problem.stamp_ns, truth.timestamp_ns, return_indices=True)
    good = np.isfinite(problem.attitude[at]).all(axis=1)
    if not good.any():
        return None
    measured, true = rotation_matrix(problem.attitude[at[good]]), rotation_matrix(truth.q[there[good]])
    return nearest_rotation((np.swapaxes(true, 1, 2) @ measured).sum(axis=0))
