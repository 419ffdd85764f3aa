"""The state that the error-state EKF of hu2024 starts from, and its run over a sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.quaternion import from_rotation_matrix, multiply, skew
from massprops.estimators.chaser_path import ChaserPath
from massprops.sensing.pinhole import Pinhole

BASE = 17
"""Errors before the features': attitude 3, rate 3, k 2, axes 3, position 3, velocity 3."""


@dataclass(frozen=True)
class FilterStart:
    """State and covariance at the first epoch, in the principal frame T (x: largest moment, z: smallest).

    Attributes:
        q: (4,) T to inertial; w: (3,) in T [rad/s]; k: (2,); axes: (4,) T to body axes; r, v: (3,) inertial [m, m/s];
        f: (m, 3) in T [m]; P: (17 + 3 m, 17 + 3 m).
    """

    q: np.ndarray
    w: np.ndarray
    k: np.ndarray
    axes: np.ndarray
    r: np.ndarray
    v: np.ndarray
    f: np.ndarray
    P: np.ndarray


@dataclass(frozen=True)
class Filtered:
    """n epochs. q (n, 4) T to inertial, w, r, v (n, 3), k (n, 2), axes (n, 4); sigma (n, 17) of the errors; f (m, 3)
    and P at the end; passed, refused: measurements; innovation: mean squared, in units of its covariance."""

    q: np.ndarray
    w: np.ndarray
    k: np.ndarray
    r: np.ndarray
    v: np.ndarray
    axes: np.ndarray
    sigma: np.ndarray
    f: np.ndarray
    P: np.ndarray
    passed: int
    refused: int
    innovation: float


def start_in_frame(
    frame: np.ndarray,
    q: np.ndarray,
    w: np.ndarray,
    k: np.ndarray,
    r: np.ndarray,
    v: np.ndarray,
    f: np.ndarray,
    sigma: dict[str, float | np.ndarray],
    body_fixed: bool = False,
    place: np.ndarray | None = None,
) -> FilterStart:
    """A start in the principal frame, with its axes' uncertainty shared by attitude, rate and features.

    An error phi of the axes turns attitude, rate and features together: d(theta) = phi, d(w) = w x phi,
    d(f) = f x phi; treating them as independent would let the filter forget that they are one rigid body.

    Args:
        frame: (3, 3) principal axes as columns in body axes; q (4,), w (3,), f (m, 3): in body axes.
        sigma: 1-sigma of attitude, rate, k (2,), axes (3,), position, velocity, features; zero position and
            velocity where there are none.
        place: (6 + 3 m, 6 + 3 m) covariance of position and velocity (inertial) and features (body axes), whose
            correlations matter: a wrong centre of mass moves all features and circles with the body.
        body_fixed: the body axes are measured (`attitude0`), and the turn to them is a state.
    """
    m = len(f)
    w, f = frame.T @ w, f @ frame
    P = np.zeros((BASE + 3 * m, BASE + 3 * m))
    diagonal = np.zeros(BASE + 3 * m)
    for at, name in ((0, "attitude"), (3, "rate"), (11, "position"), (14, "velocity")):
        diagonal[at : at + 3] = np.asarray(sigma[name], float) ** 2
    diagonal[6:8] = np.asarray(sigma["k"], float) ** 2
    diagonal[BASE:] = np.broadcast_to(np.asarray(sigma["features"], float) ** 2, (m, 3)).ravel() if m else 0.0
    P[np.diag_indices(len(P))] = diagonal
    shared = np.zeros((len(P), 3))
    shared[:3] = np.eye(3)
    shared[3:6] = skew(w)
    if body_fixed:
        shared[8:11] = np.eye(3)
    for i in range(m):
        shared[BASE + 3 * i : BASE + 3 * i + 3] = skew(f[i])
    if place is not None:
        at = np.r_[11:17, BASE : BASE + 3 * m]
        turned = np.zeros((len(at), len(at)))
        turned[:6, :6] = np.eye(6)
        for i in range(m):
            turned[6 + 3 * i : 9 + 3 * i, 6 + 3 * i : 9 + 3 * i] = frame.T
        P[np.ix_(at, at)] += turned @ place @ turned.T
    spread = np.broadcast_to(np.asarray(sigma["axes"], float) ** 2, 3)
    P += (shared * spread) @ shared.T
    turn = from_rotation_matrix(frame)
    return FilterStart(multiply(q, turn), w, np.asarray(k, float), turn, r, v, f, P)


def in_other_frame(start: FilterStart, turn: np.ndarray) -> FilterStart:
    """The same start in another of the 24 principal frames: turn (3, 3) takes its axes to the present ones."""
    order = np.argmax(np.abs(turn), axis=0)
    # logarithms of the moments over the middle one by k, and k by those
    log = np.array([[0.0, -1.0], [0.0, 0.0], [1.0, 0.0]])[order]
    ratios = np.array([[0.0, -1.0, 1.0], [-1.0, 1.0, 0.0]]) @ log
    T = np.eye(len(start.P))
    for at in (0, 3, 8, *range(BASE, len(start.P), 3)):
        T[at : at + 3, at : at + 3] = turn.T
    T[6:8, 6:8] = ratios
    other = from_rotation_matrix(turn)
    return FilterStart(
        multiply(start.q, other),
        turn.T @ start.w,
        ratios @ start.k,
        multiply(start.axes, other),
        start.r,
        start.v,
        start.f @ turn,
        T @ start.P @ T.T,
    )


def filtered(
    start: FilterStart,
    times: np.ndarray,
    cameras: tuple[Pinhole, ...],
    uv: np.ndarray,
    sigma_px: np.ndarray,
    attitude: np.ndarray,
    sigma_attitude: np.ndarray,
    path: ChaserPath,
    turn_noise: float,
    push_noise: float,
) -> Filtered:
    """Runs the compiled filter; arrays as in `Problem`, noise densities [rad^2/s^3] and [m^2/s^3]."""
    from massprops.estimators.principal.kernel import Epochs, Rig, State, run

    c = len(cameras)
    x = np.concatenate([start.q, start.w, start.k, start.r, start.v, start.axes]).astype(float)
    state = State(x, start.f.copy(), start.P.copy())
    rig = Rig(
        lens=np.array([x.intrinsics for x in cameras], float).reshape(c, 4),
        turn=np.array([camera.R for camera in cameras], float).reshape(c, 3, 3),
        shift=np.array([camera.t for camera in cameras], float).reshape(c, 3),
        variance=np.asarray(sigma_px, float) ** 2,
    )
    epochs = (times, uv, attitude, np.asarray(sigma_attitude, float) ** 2, path.q, path.place)
    out, sigma, total = run(
        state,
        Epochs(*(np.ascontiguousarray(array, float) for array in epochs)),
        rig,
        float(path.mu),
        (float(turn_noise), float(push_noise)),
    )
    return Filtered(
        q=out[:, :4],
        w=out[:, 4:7],
        k=out[:, 7:9],
        r=out[:, 9:12],
        v=out[:, 12:15],
        axes=out[:, 15:19],
        sigma=sigma,
        f=state.f,
        P=state.P,
        passed=int(total[0]),
        refused=int(total[1]),
        innovation=float(total[2]) / max(float(total[3]), 1.0),
    )


def axes_against_features(f: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) of the principal axes against the feature points (m, 3), from the filter's P."""
    C = np.concatenate([skew(x) for x in f])
    W = np.linalg.pinv(C)
    return W @ P[BASE:, BASE:] @ W.T
