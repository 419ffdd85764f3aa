"""Rotation under any list of effects.

The state is attitude and total angular momentum in body axes, over the body's mean moment of inertia: momentum stays
continuous when the mass distribution changes or a wheel spins up, the angular velocity does not. The one function
`state_derivative` is the physics, for any number of moments at once; `integrate` goes through a record by it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from massprops.core.linalg import consecutive
from massprops.dynamics.environment import EnvironmentModel, EnvironmentState
from massprops.dynamics.events import acts_at_once, struck
from massprops.dynamics.kernels import INSIDE, NODES, cross, quaternion_rate, symmetric_solve, symmetric_times
from massprops.dynamics.runge_kutta import record
from massprops.effects import is_users, places_of

LARGEST_TURN = 0.08
"""Rotation [rad] in a step of the fourth-order Runge-Kutta method: below 1e-6 rad of error a revolution."""
PACE_SHARE = 0.7
"""Of an inner part's own pace (`internal_pace`) that counts as such a rotation: derivatives by a damping of .02 of the frequency are then
off by 4 %, by 20 % and more with .5."""
MOST_STEPS = 400_000
"""Steps of integration above which a trial motion takes one between two times: it turns far too fast to fit anything."""


@dataclass(frozen=True)
class ActiveEffects:
    """Effects with their parameters' places in one flat vector.

    Attributes:
        effects: modules that act on the motion; places: the slice of each in the vector of effect parameters.
        states: the slice of each in the state's extra part.
    """

    effects: tuple[ModuleType, ...]
    places: tuple[slice, ...]

    @cached_property
    def states(self) -> tuple[slice, ...]:
        return tuple(consecutive(getattr(e, "STATES", 0) for e in self.effects))

    def __iter__(self) -> Iterator[tuple[ModuleType, slice, slice]]:
        return iter(zip(self.effects, self.places, self.states, strict=True))

    @cached_property
    def orbiting(self) -> bool:
        """Whether any of them asks where the planet is."""
        return any("orbit" in e.NEEDS for e in self.effects)

    @cached_property
    def hooks(self) -> dict[str, list[Any]]:
        """By function's name: (function, place of its parameters, place of its states within y) of those that have it."""
        return {
            name: [
                (getattr(e, name), place, slice(7 + extra.start, 7 + extra.stop))
                for e, place, extra in self
                if hasattr(e, name)
            ]
            for name in ("torque", "inertia", "internal", "internal_rate", "moving_inertia")
        }


def six_of(inertia: np.ndarray) -> tuple[Any, ...]:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz of a matrix (3, 3)."""
    return tuple(inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def angular_velocity(t: Any, y: Any, six: Any, active: ActiveEffects, p: Sequence[Any]) -> tuple[Any, ...]:
    """w from the state y = (q, h, extra): I(t) w = h - internal momentum; components."""
    hx, hy, hz = y[4], y[5], y[6]
    hooks = active.hooks
    for inertia, place, _ in hooks["inertia"]:
        six = inertia(t, six, p[place])
    for moving, place, extra in hooks["moving_inertia"]:
        six = moving(six, y[extra], p[place])
    for internal, place, extra in hooks["internal"]:
        ax, ay, az = internal(t, y[extra], p[place])
        hx, hy, hz = hx - ax, hy - ay, hz - az
    a, b, c, d, e, f = six
    return symmetric_solve(a, b, c, d, e, f, hx, hy, hz)


def state_derivative(
    t: Any, y: Sequence[Any], six: Sequence[Any], active: ActiveEffects, p: Sequence[Any], environment: EnvironmentState
) -> list[Any]:
    """Time derivative of y = (qw, qx, qy, qz, hx, hy, hz, extra ...), component by component.

    h_dot = torque - w x h (Euler's equations for the momentum), q_dot = q (0, w) / 2.
    """
    w = angular_velocity(t, y, six, active, p)
    gx, gy, gz = cross(w[0], w[1], w[2], y[4], y[5], y[6])
    tx, ty, tz = -gx, -gy, -gz
    hooks = active.hooks
    for torque, place, _ in hooks["torque"]:
        ax, ay, az = torque(t, y[0:4], w, p[place], six, environment)
        tx, ty, tz = tx + ax, ty + ay, tz + az
    out = [*quaternion_rate(y[0], y[1], y[2], y[3], *w), tx, ty, tz]
    for rate, place, extra in hooks["internal_rate"]:
        out.extend(rate(t, w, y[extra], p[place]))
    return out


def start_state(
    q0: Sequence[Any], w0: Sequence[Any], six: Sequence[Any], active: ActiveEffects, p: Sequence[Any]
) -> list[Any]:
    """State at the first time from attitude and angular velocity there."""
    now, extra = six, []
    add = [0.0, 0.0, 0.0]
    for effect, place, _ in active:
        if hasattr(effect, "inertia"):
            now = effect.inertia(0.0, now, p[place])
        z: Sequence[Any] = ()
        if hasattr(effect, "internal_start"):
            z = effect.internal_start(w0, p[place])
            extra.extend(z)
        if hasattr(effect, "moving_inertia"):
            now = effect.moving_inertia(now, z, p[place])
        if hasattr(effect, "internal"):
            add = [a + b for a, b in zip(add, effect.internal(0.0, z, p[place]), strict=True)]
    h = symmetric_times(*now, *w0)
    return [*q0, *(a + b for a, b in zip(h, add, strict=True)), *extra]


def inertia_at_start(inertia: np.ndarray, active: ActiveEffects, p: np.ndarray) -> np.ndarray:
    """The inertia (3, 3) at the start of the record with what effects change of it; its size too is theirs."""
    six = six_of(inertia)
    for change, place, _ in active.hooks["inertia"]:
        six = change(0.0, six, p[place])
    a, b, c, d, e, f = six
    return np.array([[a, d, e], [d, b, f], [e, f, c]], float)


@dataclass(frozen=True)
class Steps:
    """A grid of steps through all times and events. start, size (s,) [s]; after (n,): steps done at each time;
    jumps: (step number before which it acts, effect's place in the list); events: numbers of the steps that begin with
    an event."""

    start: np.ndarray
    size: np.ndarray
    after: np.ndarray
    jumps: tuple[tuple[int, int], ...]
    events: np.ndarray

    @cached_property
    def ends(self) -> np.ndarray:
        """(s + 1,) [s] where each begins, and where the last ends."""
        return np.append(self.start, self.start[-1] + self.size[-1])


def fastest(w0: np.ndarray, active: ActiveEffects, p: np.ndarray) -> float:
    """Rate [rad/s] that a body begun with w0 (3,) is allowed for when its steps are laid out: what moves inside may be faster."""
    inside = [float(e.internal_pace(p[place])) for e, place, _ in active if hasattr(e, "internal_pace")]
    return max([1.5 * float(np.linalg.norm(w0)) + 1e-12, *(PACE_SHARE * v for v in inside)])


def steps_through(times: np.ndarray, speed: float, active: ActiveEffects, p: np.ndarray) -> Steps:
    """Steps short enough for `speed` [rad/s], ending at every time (n,) [s] and event; p (k,): parameters of all effects."""
    inside = [(t, k) for t, k in event_times(active, p) if times[0] < t < times[-1]]
    ends = np.unique(np.concatenate([times, [t for t, _ in inside]]))
    gaps = np.diff(ends)
    counts = np.maximum(1, np.ceil(gaps * speed / LARGEST_TURN)).astype(int)
    if counts.sum() > MOST_STEPS:
        counts = np.ones_like(counts)
    size = np.repeat(gaps / counts, counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    within = np.arange(counts.sum()) - np.repeat(first[:-1], counts)
    start = np.repeat(ends[:-1], counts) + within * size
    after = first[np.searchsorted(ends, times)]
    at = [(int(first[np.searchsorted(ends, t)]), k) for t, k in inside]
    jumps = tuple((step, k) for step, k in at if k is not None and acts_at_once(active.effects[k]))
    return Steps(start, size, after, jumps, np.array([step for step, _ in at], int))


def event_times(active: ActiveEffects, p: Any) -> list[tuple[float, int | None]]:
    """(time, effect's place in the list) of the moments of effects, and without a place of the corners of what they
    do."""
    times: list[tuple[Any, int | None]] = []
    for k, (effect, place, _) in enumerate(active):
        begins = [p[place][i] for i in places_of(effect, "time")]
        lasts = [p[place][i] for i in places_of(effect, "duration")]
        times += [(t, k) for t in begins] + [(t + d, k) for t in begins for d in lasts if np.real(d) > 0]
        if hasattr(effect, "corners"):
            times += [(t, None) for t in effect.corners(p[place])]
    return [(float(np.real(t)), k) for t, k in times]


@dataclass(frozen=True)
class Trajectory:
    """q (n, 4), w (n, 3) at the times; y (s + 1, ny) at the ends of the steps, after what happens there; steps, and
    the state before a jump by its step, for the derivatives."""

    q: np.ndarray
    w: np.ndarray
    y: np.ndarray
    steps: Steps
    before: dict[int, list[Any]]


def trajectory(
    times: np.ndarray,
    q0: np.ndarray,
    w0: np.ndarray,
    inertia: np.ndarray,
    active: ActiveEffects,
    p: np.ndarray,
    environment: EnvironmentModel,
) -> Trajectory:
    """Attitude and angular velocity at `times` (n,) from those at the first.

    Args:
        q0: (4,) body to inertial; w0: (3,) body axes [rad/s].
        inertia: (3, 3), mean moment 1 (trace 3).
        active, p: effects and the flat vector of their parameters.
        environment: surroundings.
    """
    wanted = bool(active.effects) or environment.compiled
    integrate = _integrated_compiled if wanted and _in_catalogue(active) else _integrated_plainly
    six = tuple(float(v) for v in six_of(inertia))
    values = [float(v) for v in p]
    y = start_state([float(v) for v in q0], [float(v) for v in w0], six, active, values)
    steps = steps_through(times, fastest(w0, active, p), active, p)
    states = np.empty((len(steps.size) + 1, len(y)))
    jumps, before = dict(steps.jumps), {}
    pieces = [0, *sorted(jumps), len(steps.size)]
    for k, end in zip(pieces, pieces[1:], strict=False):
        if k in jumps:
            effect, place = active.effects[jumps[k]], active.places[jumps[k]]
            before[k] = y
            y = struck(y, effect, values[place])
        states[k : end + 1] = integrate(y, steps.start[k:end], steps.size[k:end], six, values, active, environment)
        y = states[end].tolist()
    at = states[steps.after]
    columns = [at[:, i] for i in range(at.shape[1])]
    w = np.stack(np.broadcast_arrays(*angular_velocity(times + INSIDE, columns, six, active, values)), axis=-1)
    q = at[:, :4] / np.linalg.norm(at[:, :4], axis=1, keepdims=True)
    return Trajectory(q, w, states, steps, before)


def _in_catalogue(active: ActiveEffects) -> bool:
    return not any(is_users(effect) for effect in active.effects)


def _integrated_compiled(*given: Any) -> np.ndarray:
    from massprops.dynamics.compiled_integration import integrated

    return integrated(*given)


def _integrated_plainly(
    y0: list[Any],
    start: np.ndarray,
    size: np.ndarray,
    six: tuple[Any, ...],
    p: list[Any],
    active: ActiveEffects,
    environment: EnvironmentModel,
) -> np.ndarray:
    """`integrate` uncompiled: for no effects, or for one that is no file of the catalogue, made for one record."""
    into = np.stack([INSIDE * size, NODES[1] * size, NODES[2] * size, size - INSIDE * size], axis=1)
    times = (start[:, None] + into).tolist()

    still = None if active.orbiting or environment.dipole is not None else environment.state(0.0, False)

    def slope(k: int, stage: int, y: list[Any]) -> list[Any]:
        t = times[k][stage]
        return state_derivative(t, y, six, active, p, still or environment.state(t))

    return record(slope, y0, size)[0]
