"""Derivatives of the rotation by every parameter (variational equations).

They follow from the one function `rotation.state_derivative` by the complex step, exact to rounding, evaluated at all moments at
once. They bend less within a step than the motion itself is asked to be known, so that several steps of the motion
make one step of theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.events import STEP, stepped, struck_jacobian
from massprops.dynamics.kernels import INSIDE, quaternion_rate
from massprops.dynamics.quaternion import conjugate, multiply
from massprops.dynamics.rotation import (
    ActiveEffects,
    Steps,
    Trajectory,
    angular_velocity,
    fastest,
    six_of,
    start_state,
    state_derivative,
)
from massprops.dynamics.runge_kutta import transition
from massprops.effects import GIVEN, places_of

LARGEST_TURN = 0.4
"""Rotation [rad] in a step: derivatives to about 1e-4 of their size after ten revolutions. An effect whose torque changes
within a smaller turn says its own `LARGEST_TURN`."""


def sensitivities(
    times: np.ndarray,
    path: Trajectory,
    q0: np.ndarray,
    w0: np.ndarray,
    inertia: np.ndarray,
    directions: np.ndarray,
    active: ActiveEffects,
    p: np.ndarray,
    environment: EnvironmentModel,
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
    flat_six, flat_p = list(six), list(np.asarray(p, float))
    fixed = _fixed(active)
    nodes = _nodes(path.steps, fastest(w0, active, p), _largest_turn(active))
    first, last = nodes[:-1], nodes[1:]
    begin = path.steps.ends[nodes]
    h = np.diff(begin)
    from_y, to_y = path.y[first], path.y[last]
    for k, y in path.before.items():
        to_y[last == k] = y
    F = _slopes_of_slopes(
        begin, np.stack([from_y, 0.5 * (from_y + to_y), to_y], axis=1), six, moves, active, flat_p, environment
    )
    M = transition(F[:, [0, 1, 1, 2]], h)
    S = _at_start(q0, w0, flat_six, moves, active, flat_p, fixed, ny)
    jumps = dict(path.steps.jumps)
    from_S, to_S = np.empty((len(h), ny, m)), np.empty((len(h), ny, m))
    for k, node in enumerate(first.tolist()):
        if node in jumps:
            S = _across(S, path, node, jumps[node], active, flat_six, flat_p, d, environment)
        from_S[k] = S
        S = M[k, :, :ny] @ S
        S += M[k, :, ny:]
        to_S[k] = S
    step = np.clip(np.searchsorted(nodes, path.steps.after) - 1, 0, len(h) - 1)
    x = (times - begin[step]) / h[step]
    x[0] = 0.0
    A, B = F[..., :ny], F[..., ny:]
    S = _between(x, h[step], [from_S, A[:, 0] @ from_S + B[:, 0], to_S, A[:, 2] @ to_S + B[:, 2]], step)
    return _outputs(times, path.y[path.steps.after], S, six, moves, active, flat_p, fixed)


def _largest_turn(active: ActiveEffects) -> float:
    return min([LARGEST_TURN, *(getattr(e, "LARGEST_TURN", LARGEST_TURN) for e in active.effects)])


def _nodes(steps: Steps, speed: float, largest_turn: float) -> np.ndarray:
    """Numbers of the steps of the motion with which those of the derivatives begin, and of the end: every event among
    them."""
    ends = steps.ends
    hard = np.unique(np.concatenate([[0, len(steps.size)], steps.events]))
    nodes = [hard]
    for a, b in zip(hard[:-1], hard[1:], strict=True):
        pieces = int(np.ceil((ends[b] - ends[a]) * speed / largest_turn))
        if pieces < b - a:
            nodes.append(np.searchsorted(ends, np.linspace(ends[a], ends[b], pieces + 1)[1:-1]))
        else:
            nodes.append(np.arange(a, b))
    return np.unique(np.concatenate(nodes))


def _fixed(active: ActiveEffects) -> set[int]:
    """Places of the parameters by which the slopes have no derivative: times of events, and what is given."""
    kinds = {place.start + i: q.kind for e, place, _ in active for i, q in enumerate(e.PARAMETERS)}
    return {i for i, kind in kinds.items() if kind in ("time", *GIVEN)}


def _slopes_of_slopes(
    begin: np.ndarray,
    ends: np.ndarray,
    six: np.ndarray,
    moves: np.ndarray,
    active: ActiveEffects,
    p: list[Any],
    environment: EnvironmentModel,
) -> np.ndarray:
    """Derivatives (steps, 3, ny, ny + m) of the motion's slopes by state and parameters at start, middle and end.

    Args:
        begin: (steps + 1,) times of the steps [s].
        ends: (steps, 3, ny) states at a step's start, the mean of both, and its end; the middle is mended in place.
        moves: (d, 6) changes of the six elements of the inertia.
    """
    ny, d, flat_six = ends.shape[-1], len(moves), list(six)
    h = np.diff(begin)
    t = begin[:-1, None] + np.array([INSIDE, 0.5, 1 - INSIDE]) * h[:, None]
    environment_state = environment.state(t, active.orbiting)
    stage = [ends[..., i] for i in range(ny)]
    rates = np.stack(np.broadcast_arrays(*state_derivative(t, stage, flat_six, active, p, environment_state)), axis=-1)
    ends[:, 1] += h[:, None] / 8.0 * (rates[:, 0] - rates[:, 2])
    F = np.zeros((*t.shape, ny, ny + 6 + d + len(p)))

    def changed(y: list[Any], six: list[Any], p: list[Any]) -> np.ndarray:
        moved_rates = state_derivative(t, y, six, active, p, environment_state)
        return np.stack(np.broadcast_arrays(*(np.imag(value) for value in moved_rates)), axis=-1) / STEP

    # the state and the inertia in one go, a step of each along a first axis: as many calls would take several times as long
    apart = np.zeros((ny + 6, ny + d, 1, 1))
    apart[:ny, :ny, 0, 0], apart[ny:, ny:, 0, 0] = np.eye(ny), moves.T
    every = [v + 1j * STEP * way for v, way in zip([*stage, *flat_six], apart, strict=True)]
    by_change = np.moveaxis(changed(every[:ny], every[ny:], p), 0, -1)
    F[..., :ny], F[..., ny + 6 : ny + 6 + d] = by_change[..., :ny], by_change[..., ny:]
    for j in sorted(_of_effects(active, tuple(active.hooks)) - _fixed(active)):
        F[..., ny + 6 + d + j] = changed(stage, flat_six, stepped(p, j))
    return F


def _at_start(
    q0: np.ndarray,
    w0: np.ndarray,
    six: list[Any],
    moves: np.ndarray,
    active: ActiveEffects,
    p: list[Any],
    fixed: set[int],
    ny: int,
) -> np.ndarray:
    """Derivatives (ny, m) of the state at the first time."""
    d, count = len(moves), len(p)
    S = np.zeros((ny, 6 + d + count))
    base_q, base_w = list(np.asarray(q0, float)), list(np.asarray(w0, float))

    def started(q: list[Any], w: list[Any], s: list[Any], v: list[Any]) -> np.ndarray:
        return np.imag(np.array(start_state(q, w, s, active, v), complex)) / STEP

    for j in range(3):
        # q (1, e/2)
        small = quaternion_rate(*base_q, *stepped([0.0] * 3, j))
        S[:, j] = started([a + b for a, b in zip(base_q, small, strict=True)], base_w, six, p)
        S[:, 3 + j] = started(base_q, stepped(base_w, j), six, p)
    for j in range(d):
        S[:, 6 + j] = started(base_q, base_w, list(np.array(six) + 1j * STEP * moves[j]), p)
    for j in sorted(set(range(count)) - fixed):
        S[:, 6 + d + j] = started(base_q, base_w, six, stepped(p, j))
    return S


def _across(
    S: np.ndarray,
    path: Trajectory,
    step: int,
    number: int,
    active: ActiveEffects,
    six: list[Any],
    p: list[Any],
    d: int,
    environment: EnvironmentModel,
) -> np.ndarray:
    """Derivatives just after what happens at once before a step, from those just before."""
    effect, place = active.effects[number], active.places[number]
    before = path.before[step]
    by_state, by_parameters = struck_jacobian(before, effect, p[place])
    moments = places_of(effect, "time")
    by_parameters[:, moments] = 0.0
    t0, inside = path.steps.start[step], INSIDE * path.steps.size[step]

    def way(t: float, y: Sequence[Any]) -> np.ndarray:
        return np.array(state_derivative(t, y, six, active, p, environment.state(t, active.orbiting)))

    leaves, begins = way(float(t0 - inside), before), way(float(t0 + inside), path.y[step])
    S = by_state @ S
    S[:, 6 + d + place.start : 6 + d + place.stop] += by_parameters
    for i in moments:
        # an event that lasts has an end, which moves with its time
        S[:, 6 + d + place.start + i] += by_state @ leaves - begins
    return S


def _between(x: np.ndarray, h: np.ndarray, ends: list[np.ndarray], step: np.ndarray) -> np.ndarray:
    """Cubic Hermite interpolation at shares x (n,) of the steps of these numbers, h (n,) [s] long: values and slopes
    (s, ...) at their starts, then at their ends."""
    square = x * x
    rest = square * (3.0 - 2.0 * x)
    weights = np.stack([1.0 - rest, h * x * (1.0 - x) ** 2, rest, h * square * (x - 1.0)], axis=-1)
    every = np.stack([e.reshape(len(e), -1) for e in ends], axis=1)
    between: np.ndarray = weights[:, None] @ every[step]
    return between.reshape(len(x), *ends[0].shape[1:])


def _of_effects(active: ActiveEffects, names: tuple[str, ...]) -> set[int]:
    """Places of the parameters of the effects that have one of these functions."""
    return {i for n in names for _, place, _ in active.hooks[n] for i in range(place.start, place.stop)}


def _outputs(
    times: np.ndarray,
    at: np.ndarray,
    S: np.ndarray,
    six: np.ndarray,
    moves: np.ndarray,
    active: ActiveEffects,
    p: list[Any],
    fixed: set[int],
) -> tuple[np.ndarray, np.ndarray]:
    d = len(moves)
    norm = np.linalg.norm(at[:, :4], axis=1)
    # the turn of a change dq is 2 vec(q* dq)
    back = conjugate(at[:, :4] / norm[:, None])[:, None]
    turn = 2.0 * np.swapaxes(multiply(back, np.swapaxes(S[:, :4] / norm[:, None, None], 1, 2))[..., 1:], 1, 2)
    t = times + INSIDE
    y = [at[:, i] for i in range(at.shape[1])]

    def changed(y: list[Any], s: list[Any], v: list[Any]) -> np.ndarray:
        w = angular_velocity(t, y, s, active, v)
        return np.stack(np.broadcast_arrays(*(np.imag(x) for x in w)), axis=-1) / STEP

    ny = at.shape[1]
    apart = np.zeros((ny + 6, ny + d, 1))
    apart[:ny, :ny, 0], apart[ny:, ny:, 0] = np.eye(ny), moves.T
    every = [v + 1j * STEP * way for v, way in zip([*y, *six], apart, strict=True)]
    by_change = np.moveaxis(changed(every[:ny], every[ny:], p), 0, -1)
    rate = by_change[..., :ny] @ S
    rate[..., 6 : 6 + d] += by_change[..., ny:]
    for j in sorted(_of_effects(active, ("inertia", "internal", "moving_inertia")) - fixed):
        rate[..., 6 + d + j] += changed(y, list(six), stepped(p, j))
    return turn, rate
