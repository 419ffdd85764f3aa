"""Where the chaser is and how it points at each epoch, as arrays for compiled filters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.orbit import lvlh_rate
from massprops.dynamics.quaternion import conjugate, from_rotation_matrix
from massprops.sequence.data import Environment


@dataclass(frozen=True)
class ChaserPath:
    """The chaser at n epochs; "inertial" axes are cam0's at the first of them.

    Attributes:
        q: (n, 4) cam0 to inertial; rate: (n, 3) angular velocity of cam0, which is the same in its own axes as in inertial
            ones [rad/s].
        place: (n, 3) from the planet's centre, inertial axes [m]; zero without an orbit.
        mu: [m^3/s^2], 0 without an orbit: then the target drifts in a straight line.
    """

    q: np.ndarray
    rate: np.ndarray
    place: np.ndarray
    mu: float


def chaser_path(given: Environment, times: np.ndarray) -> ChaserPath:
    """The chaser's path and attitude at times (n,) [s] since the first timestamp."""
    environment = EnvironmentModel(given)
    q = conjugate(from_rotation_matrix(np.array(environment.chaser_turn(times))))
    still = np.zeros((len(times), 3))
    if given.orbit is None:
        return ChaserPath(q, still, still, 0.0)
    place = np.stack(np.broadcast_arrays(*environment.position(np.asarray(times, float))), axis=-1)
    rate = lvlh_rate(given.orbit, times)[0] if environment.lvlh else still
    return ChaserPath(q, rate, place, environment.mu)


def transitions(path: ChaserPath, times: np.ndarray) -> np.ndarray:
    """(n - 1, 6, 6): position and velocity at the end of each step between the times (n,) by those at its beginning, inertial axes.

    The target's acceleration is linear in its small distance from the chaser: -mu/l^3 (r - 3 l (l.r)/l^2), which on a
    circular orbit are the Clohessy-Wiltshire equations; without an orbit the path is straight. For metres against an orbit that
    is right to one part in 10^5.
    """
    h, eye = np.diff(times)[:, None, None], np.eye(3)
    pull = np.zeros((len(h), 3, 3))
    if path.mu > 0:
        l = 0.5 * (path.place[1:] + path.place[:-1])
        distance = np.linalg.norm(l, axis=1)[:, None]
        up = l / distance
        pull = path.mu / distance[..., None] ** 3 * (3.0 * up[:, :, None] * up[:, None, :] - eye)
    F = np.empty((len(h), 6, 6))
    F[:, :3, :3] = F[:, 3:, 3:] = eye + 0.5 * h**2 * pull
    F[:, :3, 3:], F[:, 3:, :3] = h * eye + h**3 / 6.0 * pull, h * pull
    return F
