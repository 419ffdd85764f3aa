"""From one epoch to the next: the state, and its error's transition matrix. Leading axis: runs.

The rotation's derivatives are taken through its Runge-Kutta steps by the complex step, exact to rounding; the rest is
closed form. The transition is that of the whole step, not the paper's I + F dt (eq 46), which at 1.7 deg/s and 1 s
misplaces a feature 1.5 m out by 0.7 mm, more than an image does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.campaigns.papers._pesce2017_curvature import cross_covariance
from massprops.campaigns.papers._pesce2017_inertia import PARAMETERS, components
from massprops.campaigns.papers._pesce2017_state import Layout, State, additive_columns, cross, xi
from massprops.dynamics.orbit import position_velocity
from massprops.dynamics.quaternion import rotation_matrix
from massprops.geometry.vectors import skew
from massprops.sequence.data import Orbit

LARGEST_TURN = 0.12
"""Rotation [rad] per integration step: 1e-7 rad a step, far under what any epoch measures."""

COHERENCE = 40.0
"""The second-order terms below repeat from step to step while they last (they are not white): they count this many
times. Over 200 runs of pesce2017's cases the mean squared error in units of the covariance then lies within a tenth of
the number of states; without the terms it is several times that, and accuracy is the same with 5 as with 40."""


@dataclass(frozen=True)
class ProcessNoise:
    """White noise, 1-sigma per sqrt(s).

    Attributes:
        rotation: angular acceleration [rad/s^2]; translation: acceleration [m/s^2]; inertia: drift of parameters [1/s].
    """

    rotation: float = 0.0
    translation: float = 0.0
    inertia: float = 0.0


def predict(
    layout: Layout,
    state: State,
    P: np.ndarray,
    t0: float,
    t1: float,
    orbit: Orbit,
    noise: ProcessNoise,
    largest_rate: float,
) -> tuple[State, np.ndarray]:
    """State and error covariance (B, n, n) at t1 [s] from those at t0.

    Args:
        largest_rate: [rad/s] that sets the number of integration steps; the same for every run, so that no run's
            result depends on which others are with it.
    """
    ahead, F = transition(layout, state, t0, t1, orbit, largest_rate)
    curvature, places = _second_order(layout, F, P), _second_order_places(layout, ahead, F, P)
    P = F @ P @ np.swapaxes(F, -1, -2) + _process_noise(layout, ahead, t1 - t0, noise)
    P[:, layout.u, layout.u] += COHERENCE * curvature
    for at, block in zip([layout.r, *layout.points], np.moveaxis(places, 1, 0), strict=True):
        P[:, at, at] += COHERENCE * block
    return ahead, 0.5 * (P + np.swapaxes(P, -1, -2))


def transition(
    layout: Layout,
    state: State,
    t0: float,
    t1: float,
    orbit: Orbit,
    largest_rate: float,
) -> tuple[State, np.ndarray]:
    """State at t1 and the error's transition (B, n, n) from t0."""
    dt = t1 - t0
    free = layout.free
    steps = max(1, int(np.ceil(largest_rate * abs(dt) / LARGEST_TURN)))
    q1, W1, core = _rotation(free, state, dt, steps)
    r1, v1, G = _translation(state, t0, dt, orbit)
    R0, R1 = rotation_matrix(state.q), rotation_matrix(q1)
    turn = R1 @ np.swapaxes(R0, -1, -2)
    lever = np.einsum("bij,bmj->bmi", turn, state.X - state.r[:, None])
    ahead = State(W1, v1 - cross(W1, r1), r1, q1, state.k, r1[:, None] + lever)

    B, n = len(W1), free.size
    F = np.zeros((B, n, n))
    rows_w, rows_theta = core[:, :3], core[:, 3:]
    F[:, free.w], F[:, free.theta] = rows_w, rows_theta
    F[:, free.k, free.k] = np.eye(PARAMETERS)
    # the centre of mass: v = U + W x r, so dv = dU - [r] dW + [W] dr
    dv = np.zeros((B, 3, n))
    dv[:, :, free.u] = np.eye(3)
    dv[:, :, free.w] = -skew(state.r)
    dv[:, :, free.r] = skew(state.W)
    dr1 = (dt * np.eye(3) + dt**3 / 6 * G) @ dv
    dr1[:, :, free.r] += np.eye(3) + dt**2 / 2 * G
    dv1 = (np.eye(3) + dt**2 / 2 * G) @ dv
    dv1[:, :, free.r] += dt * G
    F[:, free.r] = dr1
    F[:, free.u] = dv1 + skew(r1) @ rows_w - skew(W1) @ dr1
    # features turn with the body: X1 = r1 + R1 R0^T (X0 - r0)
    gained = rows_theta.copy()
    gained[:, :, free.theta] -= np.eye(3)
    swing = R1 @ gained
    fixed = dr1
    fixed[:, :, free.r] -= turn
    F[:, free.x] = (-skew(lever) @ swing[:, None] + fixed[:, None]).reshape(B, -1, n)
    for point in free.points:
        F[:, point, point] += turn
    return (ahead, _additive(layout, F, state.q, q1)) if layout.additive else (ahead, F)


def _rotation(free: Layout, state: State, dt: float, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q and W after dt, and the rows of W and theta (B, 6, n) of the transition."""
    from massprops.campaigns.papers._pesce2017_transition_kernel import TINY, rotated

    k = np.repeat(state.k[:, None].astype(complex), 6 + PARAMETERS, axis=1)
    k[:, range(6, 6 + PARAMETERS), range(PARAMETERS)] += 1j * TINY
    q1, W1, derivatives = rotated(state.q, state.W, np.stack(components(k), axis=1), dt, steps)
    core = np.zeros((len(state.W), 6, free.size))
    core[:, :, free.w], core[:, :, free.theta.start : free.k.stop] = derivatives[:, :, :3], derivatives[:, :, 3:]
    return q1, W1, core


def _translation(state: State, t0: float, dt: float, orbit: Orbit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """r and v after dt, and the gravity gradient (3, 3) [1/s^2] amid."""
    from massprops.campaigns.papers._pesce2017_transition_kernel import moved

    r, v = state.r, state.velocity
    mu = orbit.mu_m3_s2
    leaders = position_velocity(orbit, np.array([t0, t0 + dt / 2, t0 + dt]))[0]
    r1, v1 = moved(r, v, leaders, mu, dt)
    far = np.linalg.norm(leaders[1])
    up = leaders[1] / far
    return r1, v1, mu / far**3 * (3.0 * np.outer(up, up) - np.eye(3))


def _second_order(layout: Layout, F: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Covariance (B, 3, 3) of U's largest second-order term over the step, d x e: d the error of the change of W (mostly
    that of the inertia), e that of the centre of mass. Products of zero-mean normal errors (Isserlis)."""
    change = F[:, layout.w].copy()
    change[:, :, layout.w] -= np.eye(3)
    both = change @ P
    A = both @ np.swapaxes(change, -1, -2)
    B, C = P[:, layout.r, layout.r], both[:, :, layout.r]
    return cross_covariance(A, B, C)


def _second_order_places(layout: Layout, ahead: State, F: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Covariances (B, 1 + m, 3, 3) of the second order of where the centre of mass and the features come to: the error
    of the turn over the step times that of the place."""
    theta = layout.theta
    gained = F[:, theta].copy()
    gained[:, :, theta] -= np.eye(theta.stop - theta.start)
    if layout.additive:
        gained = 2.0 * np.swapaxes(xi(ahead.q), 1, 2) @ gained
    turn = rotation_matrix(ahead.q) @ gained
    both = turn @ P
    A = both @ np.swapaxes(turn, 1, 2)
    at = [layout.r, *layout.points]
    of_places = np.stack([P[:, a, a] for a in at], axis=1)
    mixed = np.stack([both[:, :, a] for a in at], axis=1)
    return cross_covariance(np.broadcast_to(A[:, None], of_places.shape), of_places, mixed)


def _process_noise(layout: Layout, state: State, dt: float, noise: ProcessNoise) -> np.ndarray:
    n = layout.size
    Q = np.zeros((len(state.W), n, n))
    lever = skew(state.r)
    eye = np.eye(3)
    size = abs(dt) * noise.rotation**2
    Q[:, layout.w, layout.w] = size * eye
    Q[:, layout.u, layout.w] = size * lever
    Q[:, layout.w, layout.u] = size * np.swapaxes(lever, -1, -2)
    Q[:, layout.u, layout.u] = size * lever @ np.swapaxes(lever, -1, -2) + abs(dt) * noise.translation**2 * eye
    Q[:, layout.k, layout.k] = abs(dt) * noise.inertia**2 * np.eye(PARAMETERS)
    return Q


def _additive(layout: Layout, F: np.ndarray, q0: np.ndarray, q1: np.ndarray) -> np.ndarray:
    """The transition for errors with four attitude components; the component along q is carried along."""
    into, out = additive_columns(layout, q1), additive_columns(layout, q0)
    back = np.swapaxes(out, -1, -2).copy()
    back[:, 9:12] *= 4.0
    whole: np.ndarray = into @ F @ back
    whole[:, layout.theta, layout.theta] += q1[:, :, None] * q0[:, None, :]
    return whole
