"""The error-state EKF of hu2024 section 4, compiled; import it late. Prediction is in `predict_kernel`.

An epoch's measurements are absorbed block by block, linearised at one state. Where the result shows that the state
was too far off for that (after an occlusion, with precise cameras), they are linearised again at the result.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from massprops.dynamics.compiled import matrix_of, turn_between, turned
from massprops.estimators.principal.predict_kernel import (
    AXES,
    LARGEST_TURN,
    PLACE,
    POINTS,
    RATE,
    RATIO,
    SPEED,
    predict,
    step,
)

GATE_2 = 13.8
"""Squared Mahalanobis distance in two dimensions that one in a thousand good measurements exceeds."""
GATE_3 = 16.3
MOST_ROUNDS = 6
FASTEST = 100.0
"""Rate [rad/s] of a filter that is lost: there is no accuracy to keep in small steps."""
LOOSE = 100.0
"""The gate's factor while the point of linearisation is still being found."""
BENT = 0.3
"""Sigmas of a measurement that a linear prediction may be off before the update is done again at its result."""


class State(NamedTuple):
    """Changed in place: x (19,) q T to inertial 4, w 3, k 2, r 3, v 3, axes (T to body) 4; f (m, 3) features in T;
    P (17 + 3 m, 17 + 3 m)."""

    x: np.ndarray
    f: np.ndarray
    P: np.ndarray


class Epochs(NamedTuple):
    """times (n,) [s]; uv (n, c, m, 2); attitude (n, 4) body to cam0, NaN where none, and its variance (n,) [rad^2];
    camera (n, 4) cam0 to inertial; chaser (n, 3) [m]."""

    times: np.ndarray
    uv: np.ndarray
    attitude: np.ndarray
    variance: np.ndarray
    camera: np.ndarray
    chaser: np.ndarray


class Rig(NamedTuple):
    """Cameras: lens (c, 4), turn (c, 3, 3), shift (c, 3), variance (c,) of a pixel [px^2]."""

    lens: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    variance: np.ndarray


class Linear(NamedTuple):
    """A linearisation: d (D,) from the prior's state to where it is taken, dx (D,) correction of the prior's state,
    pixel (c, m, 2) predicted there and H (c, m, 2, 9) their derivatives, tally (4,): passed, refused, sum of squares,
    rows."""

    d: np.ndarray
    dx: np.ndarray
    pixel: np.ndarray
    H: np.ndarray
    tally: np.ndarray


@numba.njit(cache=True, error_model="numpy")
def _inverse(S: np.ndarray) -> np.ndarray:
    """Of a (2, 2) by hand, which is many times quicker, or any other."""
    if len(S) != 2:
        return np.ascontiguousarray(np.linalg.inv(S))
    out = np.empty((2, 2))
    whole = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    if not whole > 0.0:
        # no covariance any more: the measurement is refused
        out[:] = np.nan
        return out
    out[0, 0], out[1, 1] = S[1, 1] / whole, S[0, 0] / whole
    out[0, 1], out[1, 0] = -S[0, 1] / whole, -S[1, 0] / whole
    return out


@numba.njit(cache=True, error_model="numpy")
def _absorb(
    P: np.ndarray, dx: np.ndarray, columns: np.ndarray, H: np.ndarray, z: np.ndarray, R: np.ndarray, gate: float
) -> tuple[float, bool]:
    """One block of rows: measurement minus prediction z, Jacobian H on `columns`, noise R. Returns its normalised
    squared innovation, and whether it passed the gate; an accepted block changes P and the correction dx."""
    D, rows = P.shape[0], len(z)
    PH = np.zeros((D, rows))
    for i in range(D):
        for a in range(rows):
            total = 0.0
            for c in range(len(columns)):
                total += P[i, columns[c]] * H[a, c]
            PH[i, a] = total
    S = R.copy()
    y = z.copy()
    for a in range(rows):
        for c in range(len(columns)):
            y[a] -= H[a, c] * dx[columns[c]]
            for b in range(rows):
                S[a, b] += H[a, c] * PH[columns[c], b]
    inverse = _inverse(S)
    near = 0.0
    for a in range(rows):
        for b in range(rows):
            near += y[a] * inverse[a, b] * y[b]
    if not near < gate:
        return near, False
    K = np.empty((D, rows))
    for i in range(D):
        for a in range(rows):
            total = 0.0
            for b in range(rows):
                total += PH[i, b] * inverse[b, a]
            K[i, a] = total
    for i in range(D):
        for a in range(rows):
            dx[i] += K[i, a] * y[a]
        for j in range(i, D):
            total = P[i, j]
            for a in range(rows):
                total -= K[i, a] * PH[j, a]
            P[i, j] = total
            P[j, i] = total
    return near, True


@numba.njit(cache=True, error_model="numpy")
def _sight(
    x: np.ndarray, f: np.ndarray, R: np.ndarray, C: np.ndarray, rig: Rig, c: int, H: np.ndarray
) -> tuple[float, float, bool]:
    """Pixel of a feature f (3,) in camera c and, in H (2, 9), its derivative by attitude, position and the feature."""
    lens, turn, shift = rig.lens[c], rig.turn[c], rig.shift[c]
    X, Y = np.empty(3), np.empty(3)
    for a in range(3):
        X[a] = x[9 + a] + R[a, 0] * f[0] + R[a, 1] * f[1] + R[a, 2] * f[2]
    for a in range(3):
        Y[a] = C[0, a] * X[0] + C[1, a] * X[1] + C[2, a] * X[2] - shift[a]
    for a in range(3):
        X[a] = turn[a, 0] * Y[0] + turn[a, 1] * Y[1] + turn[a, 2] * Y[2]
    depth = max(X[2], 1e-6)
    u, v = X[0] / depth, X[1] / depth
    for a in range(3):
        H[0, 3 + a] = H[1, 3 + a] = 0.0
        for b in range(3):
            H[0, 3 + a] += lens[0] / depth * (turn[0, b] - u * turn[2, b]) * C[a, b]
            H[1, 3 + a] += lens[1] / depth * (turn[1, b] - v * turn[2, b]) * C[a, b]
    for a in range(2):
        for b in range(3):
            H[a, 6 + b] = H[a, 3] * R[0, b] + H[a, 4] * R[1, b] + H[a, 5] * R[2, b]
        # d(R f) = R (turn x f): row -(b [f x]) = f x b
        H[a, 0] = f[1] * H[a, 8] - f[2] * H[a, 7]
        H[a, 1] = f[2] * H[a, 6] - f[0] * H[a, 8]
        H[a, 2] = f[0] * H[a, 7] - f[1] * H[a, 6]
    return lens[0] * u + lens[2], lens[1] * v + lens[3], X[2] > 1e-6


@numba.njit(cache=True, error_model="numpy")
def _tell(tally: np.ndarray, good: bool, near: float, rows: int) -> None:
    """One block more: passed, refused, sum of squared normalised innovations, number of rows."""
    if good:
        tally[0] += 1
        tally[2] += near
        tally[3] += rows
    else:
        tally[1] += 1


@numba.njit(cache=True, error_model="numpy")
def _absorb_pixels(state: State, epochs: Epochs, e: int, rig: Rig, P: np.ndarray, gate: float, at: Linear) -> None:
    """The pixels of epoch e, into P and `at`."""
    x, f = state.x, state.f
    uv, camera, tally = epochs.uv[e], epochs.camera[e], at.tally
    R, C = np.empty((3, 3)), np.empty((3, 3))
    matrix_of(x[0], x[1], x[2], x[3], R)
    matrix_of(camera[0], camera[1], camera[2], camera[3], C)
    z, R2, columns = np.empty(2), np.zeros((2, 2)), np.empty(9, np.int64)
    for i in range(uv.shape[1]):
        for b in range(3):
            columns[b], columns[3 + b], columns[6 + b] = b, PLACE + b, POINTS + 3 * i + b
        for c in range(uv.shape[0]):
            if not np.isfinite(uv[c, i, 0]):
                continue
            H = at.H[c, i]
            at.pixel[c, i, 0], at.pixel[c, i, 1], ahead = _sight(x, f[i], R, C, rig, c, H)
            for a in range(2):
                z[a] = uv[c, i, a] - at.pixel[c, i, a]
                for b in range(9):
                    z[a] += H[a, b] * at.d[columns[b]]
            R2[0, 0] = R2[1, 1] = rig.variance[c]
            good, near = False, 0.0
            if ahead:
                near, good = _absorb(P, at.dx, columns, H, z, R2, gate)
            _tell(tally, good, near, 2)


@numba.njit(cache=True, error_model="numpy")
def _round(state: State, epochs: Epochs, e: int, rig: Rig, P: np.ndarray, loose: float, at: Linear) -> None:
    """Epoch e's measurements linearised at the state, which lies at.d from the prior's.

    P comes as the prior's and leaves as the posterior's; loose: the gate's factor.
    """
    at.dx[:] = 0.0
    at.tally[:] = 0.0
    _absorb_pixels(state, epochs, e, rig, P, GATE_2 * loose, at)
    x, seen, camera, tally = state.x, epochs.attitude[e], epochs.camera[e], at.tally
    if not np.isfinite(seen[0]):
        return
    B = np.empty((3, 3))
    z, H, R = np.empty(3), np.zeros((3, 6)), np.zeros((3, 3))
    columns = np.array([0, 1, 2, AXES, AXES + 1, AXES + 2])
    b = _joined(camera, x[0:4], x[15:19])
    z[0], z[1], z[2] = turn_between(b[0], b[1], b[2], b[3], seen[0], seen[1], seen[2], seen[3])
    matrix_of(x[15], x[16], x[17], x[18], B)
    for a in range(3):
        for c in range(3):
            H[a, c], H[a, 3 + c] = B[a, c], -B[a, c]
        for c in range(6):
            z[a] += H[a, c] * at.d[columns[c]]
        R[a, a] = epochs.variance[e]
    near, good = _absorb(P, at.dx, columns, H, z, R, GATE_3 * loose)
    _tell(tally, good, near, 3)


@numba.njit(cache=True, error_model="numpy")
def _bent(state: State, change: np.ndarray, epochs: Epochs, e: int, rig: Rig, at: Linear) -> float:
    """Largest difference, in sigmas, between a pixel and its linear prediction after a change of the state."""
    x, f, uv, camera = state.x, state.f, epochs.uv[e], epochs.camera[e]
    R, C, H = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 9))
    matrix_of(x[0], x[1], x[2], x[3], R)
    matrix_of(camera[0], camera[1], camera[2], camera[3], C)
    most = 0.0
    for i in range(uv.shape[1]):
        for c in range(uv.shape[0]):
            if not np.isfinite(uv[c, i, 0]):
                continue
            u, v, _ = _sight(x, f[i], R, C, rig, c, H)
            for a in range(2):
                off = (u if a == 0 else v) - at.pixel[c, i, a]
                for b in range(3):
                    off -= at.H[c, i, a, b] * change[b]
                    off -= at.H[c, i, a, 3 + b] * change[PLACE + b]
                    off -= at.H[c, i, a, 6 + b] * change[POINTS + 3 * i + b]
                most = max(most, abs(off) / np.sqrt(rig.variance[c]))
    return most


@numba.njit(cache=True, error_model="numpy")
def _moved(x0: np.ndarray, f0: np.ndarray, d: np.ndarray, x: np.ndarray, f: np.ndarray) -> None:
    """Writes the state d from (x0, f0) into (x, f)."""
    x[0], x[1], x[2], x[3] = turned(x0[0], x0[1], x0[2], x0[3], d[0], d[1], d[2])
    x[15], x[16], x[17], x[18] = turned(x0[15], x0[16], x0[17], x0[18], d[AXES], d[AXES + 1], d[AXES + 2])
    for a in range(3):
        x[4 + a] = x0[4 + a] + d[RATE + a]
        x[9 + a] = x0[9 + a] + d[PLACE + a]
        x[12 + a] = x0[12 + a] + d[SPEED + a]
        for i in range(f0.shape[0]):
            f[i, a] = f0[i, a] + d[POINTS + 3 * i + a]
    x[7], x[8] = x0[7] + d[RATIO], x0[8] + d[RATIO + 1]


@numba.njit(cache=True, error_model="numpy")
def _carried(state: State, epochs: Epochs, e: int, mu: float, noise: tuple[float, float], F: np.ndarray) -> None:
    """The state from the epoch before e to e, in place; noise: densities as of `run`."""
    x, P, chaser = state.x, state.P, epochs.chaser
    gap = epochs.times[e] - epochs.times[e - 1]
    speed = np.sqrt(x[4] * x[4] + x[5] * x[5] + x[6] * x[6])
    steps = 1
    if speed * gap > LARGEST_TURN and speed < FASTEST:
        steps = int(min(2000.0, np.ceil(speed * gap / LARGEST_TURN)))
    h = gap / steps
    for s in range(steps):
        l0 = chaser[e - 1] + (chaser[e] - chaser[e - 1]) * (s / steps)
        l1 = chaser[e - 1] + (chaser[e] - chaser[e - 1]) * ((s + 1) / steps)
        step(x[0:4], x[4:7], x[7:9], x[9:12], x[12:15], h, mu, l0, l1, F)
        predict(P, F, h, noise[0], noise[1])


@numba.njit(cache=True, error_model="numpy")
def run(
    state: State, epochs: Epochs, rig: Rig, mu: float, noise: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whole filter, from the state and covariance at the first epoch.

    Args:
        state, epochs, rig: `State`, `Epochs`, `Rig`. noise: densities of angular acceleration [rad^2/s^3] and of
        acceleration [m^2/s^3].

    Returns:
        out (n, 19): x at each epoch; sigma (n, 17); total (4,): passed, refused, sum of squared normalised
        innovations, number of rows.
    """
    x, f, P = state
    n, cams, m = epochs.uv.shape[0], epochs.uv.shape[1], epochs.uv.shape[2]
    D = P.shape[0]
    out, sigma, total = np.empty((n, 19)), np.empty((n, POINTS)), np.zeros(4)
    F, work = np.empty((POINTS, POINTS)), np.empty((D, D))
    change = np.zeros(D)
    at = Linear(np.zeros(D), np.zeros(D), np.empty((cams, m, 2)), np.empty((cams, m, 2, 9)), np.zeros(4))
    x0, f0 = x.copy(), f.copy()
    for e in range(n):
        if e > 0:
            _carried(state, epochs, e, mu, noise, F)
        x0[:] = x
        f0[:] = f
        at.d[:] = 0.0
        loose = LOOSE
        for attempt in range(MOST_ROUNDS):
            if attempt == MOST_ROUNDS - 1:
                loose = 1.0
            work[:] = P
            _round(state, epochs, e, rig, work, loose, at)
            for i in range(D):
                change[i] = at.dx[i] - at.d[i]
            if not np.isfinite(np.sum(at.dx)):
                break
            at.d[:] = at.dx
            _moved(x0, f0, at.d, x, f)
            bent = _bent(state, change, epochs, e, rig, at)
            if bent < BENT:
                if loose == 1.0:
                    break
                loose = 1.0
        P[:] = work
        total += at.tally
        out[e] = x
        for a in range(POINTS):
            sigma[e, a] = np.sqrt(max(P[a, a], 0.0))
    return out, sigma, total


@numba.njit(cache=True, error_model="numpy")
def _joined(c: np.ndarray, q: np.ndarray, a: np.ndarray) -> np.ndarray:
    """c^-1 q a^-1 of unit quaternions (4,)."""
    b = np.empty(4)
    b[0] = c[0] * q[0] + c[1] * q[1] + c[2] * q[2] + c[3] * q[3]
    b[1] = c[0] * q[1] - c[1] * q[0] - c[2] * q[3] + c[3] * q[2]
    b[2] = c[0] * q[2] + c[1] * q[3] - c[2] * q[0] - c[3] * q[1]
    b[3] = c[0] * q[3] - c[1] * q[2] + c[2] * q[1] - c[3] * q[0]
    d = np.empty(4)
    d[0] = b[0] * a[0] + b[1] * a[1] + b[2] * a[2] + b[3] * a[3]
    d[1] = -b[0] * a[1] + b[1] * a[0] - b[2] * a[3] + b[3] * a[2]
    d[2] = -b[0] * a[2] + b[1] * a[3] + b[2] * a[0] - b[3] * a[1]
    d[3] = -b[0] * a[3] - b[1] * a[2] + b[2] * a[1] + b[3] * a[0]
    return d
