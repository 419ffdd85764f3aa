"""Where the chaser is and how its cameras are turned, as a filter needs them at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.orbit import lvlh_axes, lvlh_rate
from massprops.sequence.data import Orbit


@dataclass(frozen=True)
class Surroundings:
    """The chaser's orbit, or none (the target then moves on a straight line), and whether it turns with LVLH."""

    orbit: Orbit | None = None
    turning: bool = False

    def camera_frame(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """C (3, 3), cam0 axes at t into inertial axes (cam0's at the first epoch), and their rate (3,) [rad/s]."""
        if self.orbit is None or not self.turning:
            return np.eye(3), np.zeros(3)
        now, first = lvlh_axes(self.orbit, np.array([t, 0.0]))
        return now @ first.T, lvlh_rate(self.orbit, np.asarray(t))[0]
