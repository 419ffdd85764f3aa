"""Rotation of a rigid body about its centre of mass: Euler's equations and attitude kinematics.

The body frame is any frame fixed in the body; the inertia is about the centre of mass in its axes, in any unit of
inertia (only its ratios matter without torque, and torque is in that same unit per second squared).
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import cross, quaternion_rate
from massprops.dynamics.quaternion import normalise, rotate
from massprops.dynamics.runge_kutta import step

LARGEST_TURN = 0.05
"""Rotation [rad] per integration step; with the fourth-order step below, 1e-9 rad a revolution."""


def angular_acceleration(w: np.ndarray, inertia: np.ndarray, torque: np.ndarray | float = 0.0) -> np.ndarray:
    """Euler's equations: w_dot = I^-1 (torque - w x I w), body axes.

    Args:
        w: (..., 3) angular velocity [rad/s].
        inertia: (..., 3, 3).
        torque: (..., 3) in units of the inertia per second squared.
    """
    momentum = np.einsum("...ij,...j->...i", inertia, w)
    total = torque - np.cross(w, momentum)
    return np.linalg.solve(inertia, total[..., None])[..., 0]


def propagate(
    q0: np.ndarray,
    w0: np.ndarray,
    inertia: np.ndarray,
    times: np.ndarray,
    largest_turn: float = LARGEST_TURN,
    compiled: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude and angular velocity of a free body at given times, from the state at the first of them.

    Fourth-order Runge-Kutta with equal steps between two times, each small enough that the body turns by no more
    than `largest_turn`. The result does not depend on which other times are asked for beyond rounding of that order.

    Args:
        q0: (..., 4) attitude at times[0], body to reference.
        w0: (..., 3) angular velocity at times[0], body axes [rad/s].
        inertia: (..., 3, 3) about the centre of mass, body axes.
        times: (n,) [s], in order.
        largest_turn: [rad].
        compiled: by a compiled kernel, ten times as fast and equal but for rounding, which takes half a second to load: for real
            numbers, where many integrations are to come. States from where its steps fail on are not numbers.

    Returns:
        q (n, ..., 4) unit quaternions, w (n, ..., 3) [rad/s].
    """
    inverse = np.linalg.inv(inertia)
    y = np.concatenate([q0, w0], axis=-1)
    if compiled:
        return _propagated(y, inertia, inverse, times, largest_turn)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        x, momentum = [y[..., i] for i in range(7)], np.einsum("...ij,...j->...i", inertia, y[..., 4:])
        # to the last bit as numpy's cross product and `multiply` have it, in half the time
        torque, out = np.empty_like(momentum), np.empty(y.shape, momentum.dtype)
        torque[..., 0], torque[..., 1], torque[..., 2] = cross(*x[4:], *(momentum[..., i] for i in range(3)))
        out[..., 0], out[..., 1], out[..., 2], out[..., 3] = quaternion_rate(*x)
        out[..., 4:] = np.einsum("...ij,...j->...i", inverse, -torque)
        return out

    out = [y]
    for start, end in zip(times[:-1], times[1:], strict=True):
        speed = float(np.max(np.linalg.norm(np.real(y[..., 4:]), axis=-1)))
        steps = max(1, int(np.ceil(speed * abs(end - start) / largest_turn)))
        h = (end - start) / steps
        for k in range(steps):
            y = step(slope, start + k * h, y, h)
            y[..., :4] = normalise(y[..., :4])
        out.append(y)
    path = np.stack(out)
    return path[..., :4], path[..., 4:]


def _propagated(
    y0: np.ndarray, inertia: np.ndarray, inverse: np.ndarray, times: np.ndarray, largest_turn: float
) -> tuple[np.ndarray, np.ndarray]:
    from massprops.dynamics.free_body_kernel import propagated

    shape = y0.shape
    both = [np.ascontiguousarray(np.broadcast_to(I, (*shape[:-1], 3, 3)), float) for I in (inertia, inverse)]
    I, J = (x.reshape(-1, 3, 3) for x in both)
    start, at = np.ascontiguousarray(y0, float).reshape(-1, 7), np.ascontiguousarray(times, float)
    path = np.asarray(propagated(start, I, J, at, largest_turn)).reshape(-1, *shape)
    return path[..., :4], path[..., 4:]


def angular_momentum(q: np.ndarray, w: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Angular momentum (..., 3) in the reference frame: constant without torque."""
    return rotate(q, np.einsum("...ij,...j->...i", inertia, w))


def kinetic_energy(w: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Rotational energy (...): constant without torque or dissipation."""
    return 0.5 * np.einsum("...i,...ij,...j->...", w, inertia, w)
