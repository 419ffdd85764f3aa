"""Path of the target's centre of mass relative to the chaser, inertial axes, with its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.kernels import differential_gravity
from massprops.dynamics.rotation import ActiveEffects
from massprops.dynamics.runge_kutta import record, transition

STEP = 1e-30
"""Of derivatives by the complex step."""
STEP_OF_ORBIT = 0.02
"""Longest step over the orbit's radian time sqrt(a^3 / mu)."""


def path(
    times: np.ndarray,
    r0: np.ndarray,
    v0: np.ndarray,
    active: ActiveEffects,
    p: np.ndarray,
    environment: EnvironmentModel,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position and velocity at `times` (n,): straight, or falling beside the chaser about the planet.

    Args:
        r0, v0: (3,) at times[0], inertial axes [m, m/s].
        active, p: effects on the motion; those with `displacement` move the path.

    Returns:
        r, v (n, 3), and their derivatives dr, dv (n, 3, 6 + len(p)) by r0, v0 and the effects' parameters.
    """
    n, count = len(times), len(p)
    t = times - times[0]
    dr, dv = np.zeros((n, 3, 6 + count)), np.zeros((n, 3, 6 + count))
    if not environment.falls:
        r, v = r0 + t[:, None] * v0, np.broadcast_to(v0, (n, 3)).copy()
        dr[:, :, :3] = dv[:, :, 3:6] = np.eye(3)
        dr[:, :, 3:6] = t[:, None, None] * np.eye(3)
    else:
        r, v, Phi = _fall(times, r0, v0, environment)
        dr[:, :, :6], dv[:, :, :6] = Phi[:, :3], Phi[:, 3:]
    for effect, place, _ in active:
        if not hasattr(effect, "displacement"):
            continue
        values = [float(x) for x in p[place]]
        r = r + in_rows(effect.displacement(times, values), n)
        # the velocity that goes with a displacement is its time derivative
        v = v + np.imag(in_rows(effect.displacement(times + 1j * STEP, values), n)) / STEP
        for k, by_value in enumerate(derivatives(effect.displacement, times, p[place])):
            dr[:, :, 6 + place.start + k] = by_value
    return r, v, dr, dv


def in_rows(parts: tuple[Any, ...], n: int) -> np.ndarray:
    """(n, 3) of the three components, each (n,) or one number, that an effect gives."""
    return np.stack([np.broadcast_to(x, (n,)) for x in parts], axis=-1)


def derivatives(
    function: Callable[..., tuple[Any, ...]], times: np.ndarray, values: np.ndarray
) -> Iterator[np.ndarray]:
    """Derivatives (n, 3) of an effect's `function(times, values)` by each of its values, by the complex step."""
    numbers = [float(x) for x in values]
    for k in range(len(numbers)):
        moved = [x + (1j * STEP if i == k else 0) for i, x in enumerate(numbers)]
        yield np.imag(in_rows(function(times, moved), len(times))) / STEP


def _fall(
    times: np.ndarray, r0: np.ndarray, v0: np.ndarray, environment: EnvironmentModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Differential gravity by Runge-Kutta, with the transition matrix (n, 6, 6)."""
    from scipy.interpolate import CubicHermiteSpline

    grid_times, places = _chaser(environment, float(times[0]), float(times[-1]))
    size, leader = np.diff(grid_times), places.tolist()

    def slope(k: int, stage: int, y: list[Any]) -> list[Any]:
        l = leader[(stage + 1) // 2][k]
        return [y[3], y[4], y[5], *differential_gravity(environment.mu, l[0], l[1], l[2], y[0], y[1], y[2])]

    states, stages = record(slope, [*map(float, r0), *map(float, v0)], size)
    A = np.zeros((len(size), 4, 6, 6))
    A[..., :3, 3:] = np.eye(3)
    pulls = places[[0, 1, 1, 2]].swapaxes(0, 1)
    # Battin's form holds powers of large numbers: a complex step of a metre's size stays exact
    moved = [stages[..., i] + 1e-20j * np.eye(3)[i][:, None, None] for i in range(3)]
    pull = differential_gravity(environment.mu, *(pulls[..., i] for i in range(3)), *moved)
    A[..., 3:, :3] = np.moveaxis(np.imag(np.stack(pull, axis=-1)), 0, -1) / 1e-20
    M = transition(A, size)
    Phi = np.empty((len(size) + 1, 6, 6))
    Phi[0] = np.eye(6)
    for k in range(len(size)):
        Phi[k + 1] = M[k] @ Phi[k]
    every = np.concatenate([states[:, :, None], Phi], axis=2)
    path = CubicHermiteSpline(grid_times, every[:, :3], every[:, 3:])  # it bends little within a step
    r, v = path(times), path(times, 1)
    return r[:, :, 0], v[:, :, 0], np.concatenate([r[:, :, 1:], v[:, :, 1:]], axis=1)


@lru_cache(maxsize=8)
def _chaser(environment: EnvironmentModel, first: float, last: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends (s + 1,) of steps from a time to another [s], and where the chaser is (3, s, 3) at the start, middle and end of each
    [m]: the same for every path that is tried."""
    o = environment.orbit
    assert o is not None
    longest = STEP_OF_ORBIT * float(np.sqrt((o.semi_major_axis_m * (1 - o.eccentricity)) ** 3 / o.mu_m3_s2))
    ends = np.linspace(first, last, max(2, int(np.ceil((last - first) / longest))) + 1)
    start, size = ends[:-1], np.diff(ends)
    return ends, np.stack([np.stack(environment.position(start + c * size), axis=-1) for c in (0.0, 0.5, 1.0)])
