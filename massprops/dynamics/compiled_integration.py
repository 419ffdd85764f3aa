"""Rotation under effects, compiled: step by step over a record.

Each function of an effect is compiled on its own, once, and handed to the one kernel by its address, so that a new
effect needs no kernel of its own. Imported late, for importing it loads numba.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numba.core import types as nt

from massprops.dynamics import compiled, kernels
from massprops.dynamics.environment import EnvironmentState
from massprops.dynamics.kernels import INNER, INSIDE, NODES, TOTAL
from massprops.effects import catalogue

if TYPE_CHECKING:
    from massprops.dynamics.environment import EnvironmentModel
    from massprops.dynamics.rotation import ActiveEffects

Functions = tuple[tuple[Callable[..., Any], ...], ...]
"""Compiled functions of effects, for each name of `SIGNATURES`."""

_3, _4, _6 = (nt.UniTuple(nt.float64, n) for n in (3, 4, 6))
_P = nt.Array(nt.float64, 1, "C")
_ENVIRONMENT = nt.NamedTuple((_3, _3, _3, nt.float64), EnvironmentState)
SIGNATURES = {
    "torque": _3(nt.float64, _4, _3, _P, _6, _ENVIRONMENT),
    "inertia": _6(nt.float64, _6, _P),
    "internal": _3(nt.float64, _P, _P),
    "internal_rate": _3(nt.float64, _3, _P, _P),
    "moving_inertia": _6(_6, _P, _P),
}
"""Of the effects' functions (`massprops.effects`)."""
EQUATIONS: dict[str, Callable[..., Any]] = {
    # not those to be inlined: they take no components out of a tuple
    "cross": numba.njit(kernels.cross),
    "quaternion_rate": numba.njit(kernels.quaternion_rate),
    "symmetric_times": compiled.symmetric_times,
    "symmetric_solve": compiled.symmetric_solve,
    "to_body": compiled.to_body,
    "to_reference": compiled.to_reference,
}
"""What functions of effects may call."""


@cache
def functions(name: str) -> dict[Callable[..., Any], Callable[..., Any]]:
    """The compiled functions of this name by the plain ones, of every effect of the catalogue that has one."""
    by_plain = {}
    for effect in catalogue().values():
        plain = getattr(effect, name, None)
        if plain is not None:
            names = {k: v for k, v in EQUATIONS.items() if k in plain.__globals__}
            bound = compiled.calling(plain, **names)
            by_plain[plain] = numba.cfunc(SIGNATURES[name], cache=True, error_model="numpy")(bound)
    return by_plain


def _places(name: str, active: ActiveEffects) -> np.ndarray:
    """(n, 5) of the effects that act by this function: its number, where their parameters and their states lie, from
    and to."""
    number = {plain: k for k, plain in enumerate(functions(name))}
    rows = [(number[plain], p.start, p.stop, z.start, z.stop) for plain, p, z in active.hooks[name]]
    return np.array(rows, dtype=np.int64).reshape(-1, 5)


@numba.njit(cache=True, error_model="numpy")
def _slope(
    t: float,
    y: np.ndarray,
    six: tuple[float, ...],
    p: np.ndarray,
    functions: Functions,
    places: tuple[np.ndarray, ...],
    environment_state: EnvironmentState,
    out: np.ndarray,
) -> None:
    """`rotation.state_derivative` of y (ny,) at t [s] into `out` (ny,); p: (k,) parameters; places: (n, 5) of each name's effects."""
    torques, inertias, internals, rates, moving = functions
    torque_at, inertia_at, internal_at, rate_at, moving_at = places
    hx, hy, hz = y[4], y[5], y[6]
    for k in range(len(inertia_at)):
        six = inertias[inertia_at[k, 0]](t, six, p[inertia_at[k, 1] : inertia_at[k, 2]])
    for k in range(len(moving_at)):
        effect_state = y[moving_at[k, 3] : moving_at[k, 4]]
        six = moving[moving_at[k, 0]](six, effect_state, p[moving_at[k, 1] : moving_at[k, 2]])
    for k in range(len(internal_at)):
        effect_state = y[internal_at[k, 3] : internal_at[k, 4]]
        ax, ay, az = internals[internal_at[k, 0]](t, effect_state, p[internal_at[k, 1] : internal_at[k, 2]])
        hx, hy, hz = hx - ax, hy - ay, hz - az
    w = compiled.symmetric_solve(six[0], six[1], six[2], six[3], six[4], six[5], hx, hy, hz)
    gx, gy, gz = compiled.cross(w[0], w[1], w[2], y[4], y[5], y[6])
    tx, ty, tz = -gx, -gy, -gz
    q = (y[0], y[1], y[2], y[3])
    for k in range(len(torque_at)):
        ax, ay, az = torques[torque_at[k, 0]](t, q, w, p[torque_at[k, 1] : torque_at[k, 2]], six, environment_state)
        tx, ty, tz = tx + ax, ty + ay, tz + az
    out[0], out[1], out[2], out[3] = compiled.quaternion_rate(y[0], y[1], y[2], y[3], w[0], w[1], w[2])
    out[4], out[5], out[6] = tx, ty, tz
    at = 7
    for k in range(len(rate_at)):
        effect_state = y[rate_at[k, 3] : rate_at[k, 4]]
        out[at], out[at + 1], out[at + 2] = rates[rate_at[k, 0]](t, w, effect_state, p[rate_at[k, 1] : rate_at[k, 2]])
        at += 3


@numba.njit(cache=True, error_model="numpy")
def integrate(
    y0: np.ndarray,
    start: np.ndarray,
    size: np.ndarray,
    six: tuple[float, ...],
    p: np.ndarray,
    functions: Functions,
    places: tuple[np.ndarray, ...],
    environment_state: EnvironmentState,
    along: np.ndarray,
) -> np.ndarray:
    """States (s + 1, ny) before and after each step by Runge and Kutta's fourth-order method.

    Args:
        y0: (ny,) state; start, size: (s,) [s]; six: inertia; p: (k,) parameters of all effects.
        functions: a tuple of functions for each name of `SIGNATURES`; places: for each, `_places` of those that act.
        environment_state: what does not change of the surroundings; along: (s, 3, 6) position and field at start, middle
            and end.
    """
    s, n = size.shape[0], y0.shape[0]
    out = np.empty((s + 1, n))
    f, y, z = np.empty((4, n)), np.empty(n), np.empty(n)
    for i in range(n):
        out[0, i] = y[i] = y0[i]
    for k in range(s):
        h = size[k]
        for stage in range(4):
            at = (stage + 1) // 2
            reach = NODES[stage] * h
            t = start[k] + (INSIDE * h if stage == 0 else h - INSIDE * h if stage == 3 else reach)
            for i in range(n):
                z[i] = y[i] + reach * f[stage - 1, i] if stage else y[i]
            here = EnvironmentState(
                (along[k, at, 0], along[k, at, 1], along[k, at, 2]),
                environment_state.sun,
                (along[k, at, 3], along[k, at, 4], along[k, at, 5]),
                environment_state.mu,
            )
            _slope(t, z, six, p, functions, places, here, f[stage])
        for i in range(n):
            y[i] += h / TOTAL * (f[0, i] + INNER * (f[1, i] + f[2, i]) + f[3, i])
            out[k + 1, i] = y[i]
    return out


def integrated(
    y0: Sequence[float],
    start: np.ndarray,
    size: np.ndarray,
    six: tuple[float, ...],
    p: Sequence[float],
    active: ActiveEffects,
    environment: EnvironmentModel,
) -> np.ndarray:
    """`integrate` for a list of effects in their surroundings.

    Args:
        active: `rotation.ActiveEffects`; environment: `EnvironmentModel`; the others as of `integrate`.
    """
    times = start[:, None] + np.array([0.0, 0.5, 1.0]) * size[:, None]
    environment_state = environment.state(times, active.orbiting)
    parts = (*environment_state.position, *environment_state.field)
    along = np.stack([np.broadcast_to(x, times.shape) for x in parts], axis=-1)
    still = environment_state._replace(position=(0.0, 0.0, 0.0), field=(0.0, 0.0, 0.0))
    begin, length = np.ascontiguousarray(start, float), np.ascontiguousarray(size, float)
    run, every = _typed()
    return run(
        np.array(y0, float), begin, length, tuple(float(v) for v in six), np.array(p, float), every,
        tuple(_places(n, active) for n in SIGNATURES), still, np.array(along, float),
    )  # fmt: skip


@cache
def _typed() -> tuple[Callable[..., np.ndarray], Functions]:
    """`integrate` compiled for the functions of the catalogue, and these. Called by its own name it would find the types of
    all these functions anew at each call, which is a tenth of a fit to tracks."""
    every = tuple(tuple(functions(n).values()) for n in SIGNATURES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
        types = (
            _P, _P, _P, _6, _P, numba.typeof(every), nt.UniTuple(nt.Array(nt.int64, 2, "C"), len(SIGNATURES)), _ENVIRONMENT,
            nt.Array(nt.float64, 3, "C"),
        )  # fmt: skip
        dispatcher: Any = integrate
        dispatcher.compile(types)
    return dispatcher.get_overload(types), every
