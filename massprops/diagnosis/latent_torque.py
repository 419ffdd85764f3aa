"""A torque that nothing is known of but that it is smooth: the null hypothesis that every named effect must beat.

Each component in body axes is a Gaussian process of Matern 3/2 (Rasmussen and Williams 2006, eq. 4.17), its size found by
evidence; between knots it is linear.

A second one knows one thing more: it depends on where the Sun stands in the body, in any way. It is a process over
directions, as rough as a Wiener process (exponential of the angle, which Gneiting 2013, table 1, shows to be positive
definite on a sphere), so that it may also jump.
"""

from __future__ import annotations

import numpy as np

REACH = 2.0
"""Angle [rad] over which directions are alike. A half fits jets and sunlight worse: the process is as rough with either."""
LEAST_PART = 1e-3
"""Of a process's largest eigenvalue: smaller ones are left out."""


def hats(t: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(n, k) hat functions of rising knots (k,) at times (n,): linear from one to the next, constant outside."""
    out = np.zeros((len(t), len(knots)))
    at = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    x = np.clip((t - knots[at]) / (knots[at + 1] - knots[at]), 0.0, 1.0)
    out[np.arange(len(t)), at] = 1.0 - x
    out[np.arange(len(t)), at + 1] = x
    return out


def matern(times: np.ndarray, length: float) -> np.ndarray:
    """(k, k) covariance of unit variance at times (k,), both in the same unit."""
    x = np.sqrt(3.0) * np.abs(times[:, None] - times) / length
    return np.asarray((1.0 + x) * np.exp(-x))


def by_direction(directions: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(n, k) shapes over directions (n, 3) whose independent unknowns of unit size make a rough process over the sphere,
    known at the knots (m, 3)."""

    def alike(a: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-np.arccos(np.clip(a @ knots.T, -1.0, 1.0)) / REACH))

    value, vector = np.linalg.eigh(alike(knots))
    kept = value > LEAST_PART * value[-1]
    return alike(directions) @ (vector[:, kept] / np.sqrt(value[kept]))


def factor(covariance: np.ndarray) -> np.ndarray:
    """(k, k) A with A A^T the covariance, by its eigenvectors."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))


def three_axes(shape: np.ndarray) -> np.ndarray:
    """(n, 3, 3 k) columns of a vector whose components each are a combination of shapes (n, k): those of x first."""
    n, k = shape.shape
    out = np.zeros((n, 3, 3, k))
    for i in range(3):
        out[:, i, i] = shape
    return out.reshape(n, 3, 3 * k)
