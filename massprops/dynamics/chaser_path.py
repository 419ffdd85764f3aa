"""Where the chaser is and how it points at each epoch, as arrays for compiled filters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.quaternion import conjugate, from_rotation_matrix
from massprops.dynamics.surroundings import Surroundings
from massprops.sequence.data import Environment


@dataclass(frozen=True)
class ChaserPath:
    """The chaser at n epochs; "inertial" axes are cam0's at the first of them.

    Attributes:
        q: (n, 4) cam0 to inertial.
        place: (n, 3) from the planet's centre, inertial axes [m]; zero without an orbit.
        mu: [m^3/s^2], 0 without an orbit: then the target drifts in a straight line.
    """

    q: np.ndarray
    place: np.ndarray
    mu: float


def chaser_path(environment: Environment, times: np.ndarray) -> ChaserPath:
    """The chaser's path and attitude at times (n,) [s] since the first timestamp."""
    around = Surroundings(environment)
    q = conjugate(from_rotation_matrix(np.array(around.chaser_turn(times))))
    if environment.orbit is None:
        return ChaserPath(q, np.zeros((len(times), 3)), 0.0)
    place = np.stack(np.broadcast_arrays(*around.position(np.asarray(times, float))), axis=-1)
    return ChaserPath(q, place, around.mu)
