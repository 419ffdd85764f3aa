"""Where the chaser is and how its cameras are turned, as a filter needs them at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.orbit import lvlh_axes, lvlh_rate, position_velocity
from massprops.sequence.data import Environment, Orbit


@dataclass(frozen=True)
class Surroundings:
    """The chaser's orbit, or none (the target then moves on a straight line), and whether it turns with LVLH."""

    orbit: Orbit | None = None
    turning: bool = False

    def leader(self, t: float) -> np.ndarray | None:
        """(3,) chaser from the Earth's centre [m], inertial axes, at t [s] after the first epoch."""
        return None if self.orbit is None else position_velocity(self.orbit, np.asarray(t))[0]

    def leaders(self, times: np.ndarray) -> np.ndarray | None:
        """(n - 1, 3, 3) the chaser at the beginning, middle and end of each step between `times` (n,) [s]."""
        if self.orbit is None:
            return None
        ways = np.stack([times[:-1], 0.5 * (times[:-1] + times[1:]), times[1:]], axis=1)
        return position_velocity(self.orbit, ways)[0]

    def camera_frame(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """C (3, 3), cam0 axes at t into inertial axes (cam0's at the first epoch), and their rate (3,) [rad/s]."""
        if self.orbit is None or not self.turning:
            return np.eye(3), np.zeros(3)
        now, first = lvlh_axes(self.orbit, np.array([t, 0.0]))
        return now @ first.T, lvlh_rate(self.orbit, np.asarray(t))[0]


def surroundings_of(environment: Environment) -> Surroundings:
    """What a sequence's environment says of the chaser."""
    return Surroundings(environment.orbit, environment.chaser_attitude == "lvlh")
