"""Rotation under any list of effects, with its derivatives by every parameter (variational equations).

The state is attitude and total angular momentum in body axes, over the body's mean moment of inertia: momentum stays
continuous when the mass distribution changes or a wheel spins up, the angular velocity does not. The one function
`slope` is the physics; the derivatives follow from it by the complex step, exact to rounding, evaluated at all stages
of all steps at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from massprops.dynamics.events import acts_at_once, struck, struck_slopes
from massprops.dynamics.kernels import cross, quaternion_rate, symmetric_solve, symmetric_times
from massprops.dynamics.surroundings import Surroundings

LARGEST_TURN = 0.08
"""Rotation [rad] in a step of the fourth-order Runge-Kutta method: below 1e-6 rad of error a revolution."""
MOST_STEPS = 400_000
INSIDE = 1e-7
"""Stages at the ends of a step lie this share of it inside, so that an event at a step's end acts in one step only."""


@dataclass(frozen=True)
class Acting:
    """Effects with their parameters' places in one flat vector.

    Attributes:
        effects: modules that act on the motion; places: the slice of each in the vector of effect parameters.
        states: the slice of each in the state's extra part.
    """

    effects: tuple[ModuleType, ...]
    places: tuple[slice, ...]

    @cached_property
    def states(self) -> tuple[slice, ...]:
        at, out = 0, []
        for effect in self.effects:
            count = getattr(effect, "STATES", 0)
            out.append(slice(at, at + count))
            at += count
        return tuple(out)

    @property
    def extra(self) -> int:
        return sum(getattr(e, "STATES", 0) for e in self.effects)

    def __iter__(self):
        return iter(zip(self.effects, self.places, self.states, strict=True))

    @cached_property
    def having(self) -> dict[str, list]:
        """By function's name: (function, place of its parameters, place of its states within y) of those that have it."""
        return {
            name: [
                (getattr(e, name), place, slice(7 + own.start, 7 + own.stop))
                for e, place, own in self
                if hasattr(e, name)
            ]
            for name in ("torque", "inertia", "internal", "internal_rate")
        }


def six_of(inertia: np.ndarray) -> tuple[Any, ...]:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz of a matrix (3, 3)."""
    return tuple(inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def angular_velocity(t: Any, y: Any, six: Any, acting: Acting, p: Sequence) -> tuple:
    """w from the state y = (q, h, extra): I(t) w = h - internal momentum; components."""
    hx, hy, hz = y[4], y[5], y[6]
    having = acting.having
    for inertia, place, _ in having["inertia"]:
        six = inertia(t, six, p[place])
    for internal, place, own in having["internal"]:
        ax, ay, az = internal(t, y[own], p[place])
        hx, hy, hz = hx - ax, hy - ay, hz - az
    a, b, c, d, e, f = six
    return symmetric_solve(a, b, c, d, e, f, hx, hy, hz)


def slope(t: Any, y: Sequence, six: Sequence, acting: Acting, p: Sequence, around: Surroundings) -> list:
    """Time derivative of y = (qw, qx, qy, qz, hx, hy, hz, extra ...), component by component.

    h_dot = torque - w x h (Euler's equations for the momentum), q_dot = q (0, w) / 2.
    """
    w = angular_velocity(t, y, six, acting, p)
    gx, gy, gz = cross(w[0], w[1], w[2], y[4], y[5], y[6])
    tx, ty, tz = -gx, -gy, -gz
    having = acting.having
    for torque, place, _ in having["torque"]:
        ax, ay, az = torque(t, y[0:4], w, p[place], six, around)
        tx, ty, tz = tx + ax, ty + ay, tz + az
    out = [*quaternion_rate(y[0], y[1], y[2], y[3], *w), tx, ty, tz]
    for rate, place, own in having["internal_rate"]:
        out.extend(rate(t, w, y[own], p[place]))
    return out


def start_state(q0: Sequence, w0: Sequence, six: Sequence, acting: Acting, p: Sequence) -> list:
    """State at the first time from attitude and angular velocity there."""
    now, extra = six, []
    add = [0.0, 0.0, 0.0]
    for effect, place, _ in acting:
        if hasattr(effect, "inertia"):
            now = effect.inertia(0.0, now, p[place])
        z: Sequence = ()
        if hasattr(effect, "internal_start"):
            z = effect.internal_start(w0, p[place])
            extra.extend(z)
        if hasattr(effect, "internal"):
            add = [a + b for a, b in zip(add, effect.internal(0.0, z, p[place]), strict=True)]
    h = symmetric_times(*now, *w0)
    return [*q0, *(a + b for a, b in zip(h, add, strict=True)), *extra]


def inertia_at_start(inertia: np.ndarray, acting: Acting, p: np.ndarray) -> np.ndarray:
    """The inertia (3, 3) at the start of the record with what effects change of it; its size too is theirs."""
    six = six_of(inertia)
    for change, place, _ in acting.having["inertia"]:
        six = change(0.0, six, p[place])
    a, b, c, d, e, f = six
    return np.array([[a, d, e], [d, b, f], [e, f, c]], float)


@dataclass(frozen=True)
class Steps:
    """A grid of steps through all times and events. start, size (s,) [s]; after (n,): steps done at each time;
    jumps: (step number before which it acts, effect's place in the list)."""

    start: np.ndarray
    size: np.ndarray
    after: np.ndarray
    jumps: tuple[tuple[int, int], ...]


def steps_through(times: np.ndarray, speed: float, acting: Acting, p: np.ndarray) -> Steps:
    """Steps short enough for `speed` [rad/s], ending at every time and event."""
    events = [(float(np.real(v)), k) for k, v in event_times(acting, p)]
    ends = np.unique(np.concatenate([times, [t for t, _ in events if times[0] < t < times[-1]]]))
    gaps = np.diff(ends)
    counts = np.maximum(1, np.ceil(gaps * speed / LARGEST_TURN)).astype(int)
    if counts.sum() > MOST_STEPS:
        counts = np.ones_like(counts)
    size = np.repeat(gaps / counts, counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    inside = np.arange(counts.sum()) - np.repeat(first[:-1], counts)
    start = np.repeat(ends[:-1], counts) + inside * size
    after = first[np.searchsorted(ends, times)]
    jumps = tuple(
        (int(first[np.searchsorted(ends, t)]), k)
        for t, k in events
        if times[0] < t < times[-1] and acts_at_once(acting.effects[k])
    )
    return Steps(start, size, after, jumps)


def event_times(acting: Acting, p: Any) -> list[tuple[int, Any]]:
    """(effect's place in the list, its time) of every effect that acts at one moment."""
    found = []
    for k, (effect, place, _) in enumerate(acting):
        for i, parameter in enumerate(effect.PARAMETERS):
            if parameter.kind == "time":
                found.append((k, p[place][i]))
    return found


@dataclass(frozen=True)
class Trajectory:
    """q (n, 4), w (n, 3) at the times; stages (s, 4, ny), steps, and the state before a jump by its step, for the
    derivatives."""

    q: np.ndarray
    w: np.ndarray
    y: np.ndarray
    stages: np.ndarray
    steps: Steps
    before: dict[int, list]


def trajectory(
    times: np.ndarray,
    q0: np.ndarray,
    w0: np.ndarray,
    inertia: np.ndarray,
    acting: Acting,
    p: np.ndarray,
    around: Surroundings,
) -> Trajectory:
    """Attitude and angular velocity at `times` (n,) from those at the first.

    Args:
        q0: (4,) body to inertial; w0: (3,) body axes [rad/s].
        inertia: (3, 3), mean moment 1 (trace 3).
        acting, p: effects and the flat vector of their parameters.
        around: surroundings.
    """
    six = tuple(float(v) for v in six_of(inertia))
    values = [float(v) for v in p]
    y = start_state([float(v) for v in q0], [float(v) for v in w0], six, acting, values)
    steps = steps_through(times, 1.5 * float(np.linalg.norm(w0)) + 1e-12, acting, p)
    stages = np.empty((len(steps.size), 4, len(y)))
    states = np.empty((len(steps.size) + 1, len(y)))
    states[0] = y
    jumps, before = dict(steps.jumps), {}
    for k, (t, h) in enumerate(zip(steps.start.tolist(), steps.size.tolist(), strict=True)):
        if k in jumps:
            effect, place = acting.effects[jumps[k]], acting.places[jumps[k]]
            before[k] = y
            states[k] = y = struck(y, effect, values[place])
        half = 0.5 * h
        f1 = slope(t + INSIDE * h, y, six, acting, values, around)
        y2 = [a + half * b for a, b in zip(y, f1, strict=True)]
        f2 = slope(t + half, y2, six, acting, values, around)
        y3 = [a + half * b for a, b in zip(y, f2, strict=True)]
        f3 = slope(t + half, y3, six, acting, values, around)
        y4 = [a + h * b for a, b in zip(y, f3, strict=True)]
        f4 = slope(t + h - INSIDE * h, y4, six, acting, values, around)
        stages[k, 0], stages[k, 1], stages[k, 2], stages[k, 3] = y, y2, y3, y4
        sixth = h / 6.0
        y = [a + sixth * (b + 2.0 * (c + d) + e) for a, b, c, d, e in zip(y, f1, f2, f3, f4, strict=True)]
        states[k + 1] = y
    at = states[steps.after]
    columns = [at[:, i] for i in range(at.shape[1])]
    w = np.stack(np.broadcast_arrays(*angular_velocity(times + INSIDE, columns, six, acting, values)), axis=-1)
    q = at[:, :4] / np.linalg.norm(at[:, :4], axis=1, keepdims=True)
    return Trajectory(q, w, states, stages, steps, before)


def sensitivities(
    times: np.ndarray,
    path: Trajectory,
    q0: np.ndarray,
    w0: np.ndarray,
    inertia: np.ndarray,
    directions: np.ndarray,
    acting: Acting,
    p: np.ndarray,
    around: Surroundings,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of attitude (a small turn in body axes) and angular velocity at the times.

    Args:
        directions: (d, 3, 3) changes of the inertia, one for each inertia parameter.

    Returns:
        (n, 3, m) and (n, 3, m) by m = 3 (attitude at the start, body axes) + 3 (w0) + d + len(p) parameters; by the
        moment of an event as slopes before and after it differ.
    """
    ny, d, count = path.y.shape[1], len(directions), len(p)
    m = 6 + d + count
    six = np.array(six_of(inertia))
    moves = np.array([six_of(x) for x in directions]).reshape(d, 6)
    step = 1e-30
    h = path.steps.size
    ends = np.array([INSIDE, 0.5, 0.5, 1 - INSIDE])
    t = path.steps.start[:, None] + ends * h[:, None]
    stage = [path.stages[..., i] for i in range(ny)]
    flat_six, flat_p = list(six), list(np.asarray(p, float))

    def imaginary(values: list) -> np.ndarray:
        return np.stack([np.imag(np.broadcast_to(v, t.shape)) for v in values], axis=-1) / step

    A = np.empty((*t.shape, ny, ny))
    for j in range(ny):
        y = list(stage)
        y[j] = y[j] + 1j * step
        A[..., j] = imaginary(slope(t, y, flat_six, acting, flat_p, around))
    B = np.zeros((*t.shape, ny, m))
    for j in range(d):
        B[..., 6 + j] = imaginary(slope(t, stage, list(six + 1j * step * moves[j]), acting, flat_p, around))
    timed = {place.start + i for e, place, _ in acting for i, q in enumerate(e.PARAMETERS) if q.kind == "time"}
    for j in range(count):
        if j not in timed:
            moved = [v + (1j * step if i == j else 0) for i, v in enumerate(flat_p)]
            B[..., 6 + d + j] = imaginary(slope(t, stage, flat_six, acting, moved, around))
    F = np.concatenate([A, B], axis=-1)
    hh = h[:, None, None]
    eye = np.concatenate([np.eye(ny), np.zeros((ny, m))], axis=1)

    def carried(stage_F: np.ndarray, sofar: np.ndarray) -> np.ndarray:
        out = stage_F[..., :ny] @ sofar
        out[..., ny:] += stage_F[..., ny:]
        return out

    K1 = F[:, 0]
    K2 = carried(F[:, 1], eye + 0.5 * hh * K1)
    K3 = carried(F[:, 2], eye + 0.5 * hh * K2)
    K4 = carried(F[:, 3], eye + hh * K3)
    M = eye + hh / 6.0 * (K1 + 2 * (K2 + K3) + K4)
    # derivative of the start state
    S = np.zeros((ny, m))
    base_q, base_w = list(np.asarray(q0, float)), list(np.asarray(w0, float))

    def started(q: list, w: list, s: list, v: list) -> np.ndarray:
        return np.imag(np.array(start_state(q, w, s, acting, v), complex)) / step

    for j in range(3):
        small = [1j * step / 2 if i == j else 0 for i in range(3)]
        qw, qx, qy, qz = base_q
        # q (1, e/2)
        q = [
            qw - qx * small[0] - qy * small[1] - qz * small[2],
            qx + qw * small[0] + qy * small[2] - qz * small[1],
            qy + qw * small[1] - qx * small[2] + qz * small[0],
            qz + qw * small[2] + qx * small[1] - qy * small[0],
        ]
        S[:, j] = started(q, base_w, flat_six, flat_p)
        w = [v + (1j * step if i == j else 0) for i, v in enumerate(base_w)]
        S[:, 3 + j] = started(base_q, w, flat_six, flat_p)
    for j in range(d):
        S[:, 6 + j] = started(base_q, base_w, list(six + 1j * step * moves[j]), flat_p)
    for j in range(count):
        if j not in timed:
            S[:, 6 + d + j] = started(
                base_q, base_w, flat_six, [v + (1j * step if i == j else 0) for i, v in enumerate(flat_p)]
            )
    jumps = dict(path.steps.jumps)
    all_S = np.empty((len(h) + 1, ny, m))
    all_S[0] = S
    for k in range(len(h)):
        if k in jumps:
            effect, place = acting.effects[jumps[k]], acting.places[jumps[k]]
            by_state, own = struck_slopes(path.before[k], effect, flat_p[place])
            own[:, [i - place.start for i in timed if place.start <= i < place.stop]] = 0.0
            S = by_state @ S
            S[:, 6 + d + place.start : 6 + d + place.stop] += own
            t0, inside = path.steps.start[k], INSIDE * h[k]
            leaves = np.array(slope(t0 - inside, path.before[k], flat_six, acting, flat_p, around))
            begins = np.array(slope(t0 + inside, path.y[k], flat_six, acting, flat_p, around))
            for j in (i for i in timed if place.start <= i < place.stop):
                S[:, 6 + d + j] = by_state @ leaves - begins
        S = M[k, :, :ny] @ S
        S += M[k, :, ny:]
        all_S[k + 1] = S
    S = all_S[path.steps.after]
    at = path.y[path.steps.after]
    return _outputs(times, at, S, six, moves, acting, flat_p, d, timed)


def _small_turn(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Body-axes turn (n, 3, ...) of a change dq (n, 4, ...): 2 vec(q* dq)."""
    w, x, y, z = (q[:, i].reshape(-1, *([1] * (dq.ndim - 2))) for i in range(4))
    a, b, c, e = (dq[:, i] for i in range(4))
    return 2.0 * np.stack(
        [w * b - x * a - y * e + z * c, w * c - y * a - z * b + x * e, w * e - z * a - x * c + y * b], axis=1
    )


def _outputs(
    times: np.ndarray,
    at: np.ndarray,
    S: np.ndarray,
    six: np.ndarray,
    moves: np.ndarray,
    acting: Acting,
    p: list,
    d: int,
    timed: set[int],
) -> tuple[np.ndarray, np.ndarray]:
    step = 1e-30
    norm = np.linalg.norm(at[:, :4], axis=1)
    turn = _small_turn(at[:, :4] / norm[:, None], S[:, :4] / norm[:, None, None])
    t = times + INSIDE
    y = [at[:, i] for i in range(at.shape[1])]

    def velocity(y: list, s: list, v: list) -> np.ndarray:
        w = angular_velocity(t, y, s, acting, v)
        return np.stack([np.imag(np.broadcast_to(x, t.shape)) for x in w], axis=-1) / step

    W_y = np.zeros((len(t), 3, at.shape[1]))
    for j in range(4, at.shape[1]):
        W_y[..., j] = velocity([v + (1j * step if i == j else 0) for i, v in enumerate(y)], list(six), p)
    rate = W_y @ S
    for j in range(d):
        rate[..., 6 + j] += velocity(y, list(six + 1j * step * moves[j]), p)
    for j in range(len(p)):
        if j not in timed:
            rate[..., 6 + d + j] += velocity(y, list(six), [v + (1j * step if i == j else 0) for i, v in enumerate(p)])
    return turn, rate
