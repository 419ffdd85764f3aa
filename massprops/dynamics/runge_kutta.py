"""Runge and Kutta's method of fourth order: one step, a record of steps, and the transition matrices of steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


def step(slope: Callable[[float, np.ndarray], np.ndarray], t: float, y: np.ndarray, h: float) -> np.ndarray:
    """The state y (...) a time h after t, where its derivative is slope(t, y)."""
    k1 = slope(t, y)
    k2 = slope(t + h / 2, y + h / 2 * k1)
    k3 = slope(t + h / 2, y + h / 2 * k2)
    k4 = slope(t + h, y + h * k3)
    return np.asarray(y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def record(
    slope: Callable[[int, int, list[Any]], list[Any]], y0: list[Any], size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """States before and after each step (s + 1, n), and at its four stages (s, 4, n), component by component.

    Args:
        slope: derivative, from the number of the step, of the stage (start, middle, middle, end), and the state there.
        size: (s,) steps.
    """
    y, states, stages = y0, [y0], list[list[Any]]()
    for k, h in enumerate(size.tolist()):
        slopes: list[list[Any]] = []
        for stage, reach in enumerate((0.0, 0.5 * h, 0.5 * h, h)):
            z = [a + reach * b for a, b in zip(y, slopes[-1], strict=True)] if slopes else y
            stages.append(z)
            slopes.append(slope(k, stage, z))
        y = [a + h / 6.0 * (b + 2.0 * (c + d) + e) for a, b, c, d, e in zip(y, *slopes, strict=True)]
        states.append(y)
    return np.array(states), np.array(stages, float).reshape(len(size), 4, len(y0))


def transition(F: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Derivatives (s, n, n + m) of the state after each step h (s,) by that before it, and by m parameters.

    Args:
        F: (s, 4, n, n + m) derivatives of the slope by the state and the parameters, at the four stages.
    """
    n, h, eye = F.shape[2], h[:, None, None], np.eye(*F.shape[2:])

    def carried(stage: int, sofar: np.ndarray) -> np.ndarray:
        out: np.ndarray = F[:, stage, :, :n] @ sofar
        out[..., n:] += F[:, stage, :, n:]
        return out

    k1 = F[:, 0]
    k2 = carried(1, eye + 0.5 * h * k1)
    k3 = carried(2, eye + 0.5 * h * k2)
    k4 = carried(3, eye + h * k3)
    return np.asarray(eye + h / 6.0 * (k1 + 2 * (k2 + k3) + k4))
