"""Residuals of an attitude history from the best free rotation with a given inertia."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_vector, multiply, rotation_vector
from massprops.dynamics.rigid_body import propagate

STEP = 1e-6
"""Of the differences, in turn and rate [rad]."""


def free_rotation_residuals(times: np.ndarray, q: np.ndarray, sigma: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """(n, 3) turns [rad], body axes, from the best free rotation with this inertia to the attitudes.

    Gauss-Newton over the first attitude and rate; nothing else is free.

    Args:
        times: (n,) [s]; q: (n, 4) body to cam0; sigma: (n,) [rad]; inertia: (3, 3) body axes.
    """
    weight = 1.0 / sigma
    first = np.median(np.diff(times))
    step = max(1, int(round(0.3 / max(_speed(times, q) * first, 1e-9))))
    step = min(step, len(times) - 1)
    q0, w0 = q[0], rotation_vector(multiply(conjugate(q[0]), q[step])) / (times[step] - times[0])

    def residual(turn: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """(b, n, 3) of a batch of starts."""
        start = multiply(np.broadcast_to(q0, (len(turn), 4)), from_rotation_vector(turn))
        path, _ = propagate(start, rate, inertia, times, largest_turn=0.1, compiled=True)
        return rotation_vector(multiply(conjugate(np.swapaxes(path, 0, 1)), q[None]))

    # the span grows, so that a start that is a little off cannot lose a whole turn by the end
    for reach in (*np.linspace(0.15, 0.85, 5), *[1.0] * 12):
        use = np.arange(len(times)) < max(8, int(np.ceil(reach * len(times))))
        scale = max(float(np.linalg.norm(w0)), 1e-9)
        turns = np.zeros((7, 3))
        rates = np.tile(w0, (7, 1))
        turns[1:4], rates[4:] = STEP * np.eye(3), w0 + STEP * scale * np.eye(3)
        both = residual(turns, rates)
        r = (both[0] * weight[:, None])[use].ravel()
        J = ((both[1:] - both[0]) * weight[None, :, None])[:, use].reshape(6, -1).T / STEP
        change = -np.linalg.lstsq(J, r, rcond=1e-10)[0]
        change *= min(1.0, 0.5 / max(float(np.abs(change).max()), 1e-12))
        q0, w0 = multiply(q0, from_rotation_vector(change[:3])), w0 + scale * change[3:]
        if reach == 1.0 and np.abs(change).max() < 1e-9:
            break
    return residual(np.zeros((1, 3)), w0[None])[0]


def _speed(times: np.ndarray, q: np.ndarray) -> float:
    turn = np.linalg.norm(rotation_vector(multiply(conjugate(q[:-1]), q[1:])), axis=1)
    return float(np.median(turn / np.diff(times)))
