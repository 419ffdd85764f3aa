"""Attitudes with noise of the bodies that MuJoCo moves in `diagnose.mujoco_bodies`."""

from __future__ import annotations

import numpy as np
from diagnose.mujoco_bodies import BODIES, moved
from scipy.spatial.transform import Rotation

from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise
from massprops.sequence.data import AttitudeSeries, Environment, Sequence

SIGMA = np.radians(0.1)


def right(name: str, seed: int) -> str:
    """What may be named: a ball that came back has struck twice, in one push or two."""
    twice = " | impulse + second-impulse" if moved(BODIES[name], seed).strikes > 1 else ""
    return BODIES[name].effect + twice


def recorded(name: str, seed: int, sigma: float = SIGMA) -> tuple[Sequence, str]:
    """A record, and which effect acts in it."""
    motion = moved(BODIES[name], seed)
    q = Rotation.from_matrix(motion.R).as_quat()[:, [3, 0, 1, 2]]
    noise = sigma * np.random.default_rng([seed, 79]).standard_normal((len(q), 3))
    noisy = normalise(multiply(q, from_rotation_vector(noise)))
    series = AttitudeSeries(np.round(motion.times * 1e9).astype(np.int64), noisy, np.full(len(q), sigma))
    return Sequence(attitude=series, environment=Environment()), BODIES[name].effect
