"""Runge and Kutta's method of fourth order: one step, a record of steps, and the transition matrices of steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from massprops.dynamics.kernels import INNER, NODES, TOTAL


def step(slope: Callable[[float, np.ndarray], np.ndarray], t: float, y: np.ndarray, h: float) -> np.ndarray:
    """The state y (...) a time h after t, where its derivative is slope(t, y)."""
    _, c2, c3, c4 = NODES
    k1 = slope(t, y)
    k2 = slope(t + c2 * h, y + c2 * h * k1)
    k3 = slope(t + c3 * h, y + c3 * h * k2)
    k4 = slope(t + c4 * h, y + c4 * h * k3)
    return np.asarray(y + h / TOTAL * (k1 + INNER * k2 + INNER * k3 + k4))


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
        for stage, node in enumerate(NODES):
            reach = node * h
            z = [a + reach * b for a, b in zip(y, slopes[-1], strict=True)] if slopes else y
            stages.append(z)
            slopes.append(slope(k, stage, z))
        y = [a + h / TOTAL * (b + INNER * (c + d) + e) for a, b, c, d, e in zip(y, *slopes, strict=True)]
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
    k2 = carried(1, eye + NODES[1] * h * k1)
    k3 = carried(2, eye + NODES[2] * h * k2)
    k4 = carried(3, eye + NODES[3] * h * k3)
    return np.asarray(eye + h / TOTAL * (k1 + INNER * (k2 + k3) + k4))
