"""The unscented filter of volpe2017 for one camera and ranges, compiled; import it late.

Errors in order: attitude 3 (a turn about the body axes), rate 3, inertia 5, position 3, velocity 3, features 3 each. The
paper's six inertia elements hold one that nothing shows, the scale; here the inertia is that of
`inertia_parameters`' general form, five numbers.

With P = L L^T, L lower triangular, a feature's columns of L move that feature and later ones only: the equations of
motion are solved for the first 17 columns alone. Sums over pairs of sigma points are taken as half differences (odd)
and half sums (even), none with a negative weight, so P stays positive definite.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from massprops.dynamics.compiled import (
    differential_gravity,
    euler_acceleration,
    matrix_of,
    quaternion_rate,
    to_body,
    turn_between,
    turned,
)

BASE = 17
LARGEST_TURN = 0.1
"""Rotation [rad] per integration step."""
SPREAD = np.sqrt(3.0)
"""Distance of the sigma points in standard deviations: it matches a normal distribution's fourth moment."""
TINY = 1e-14
Six = tuple[float, float, float, float, float, float]


class Moving(NamedTuple):
    """The state, changed in place: y (13,) q body to inertial, w, r, v; s (5,) inertia; f (m, 3) features in body axes;
    P (17 + 3 m, 17 + 3 m); L, room for the factor of P."""

    y: np.ndarray
    s: np.ndarray
    f: np.ndarray
    P: np.ndarray
    L: np.ndarray


class Rule(NamedTuple):
    """lens: (4,). Variances of a pixel and of a range; gate: squared sigmas; mu: of the planet, 0 without; noise
    densities as of `filter.range_filtered`, squared."""

    lens: np.ndarray
    pixel_variance: float
    range_variance: float
    gate: float
    mu: float
    turn_noise: float
    push_noise: float


class Rows(NamedTuple):
    """Innovations of an epoch: which measurement each is (2 i + axis, or 2 m for the range), half differences and half
    sums of the sigma points (N, rows), their value and covariance."""

    index: np.ndarray
    odd: np.ndarray
    even: np.ndarray
    value: np.ndarray
    S: np.ndarray


@numba.njit(cache=True)
def six_elements(s: np.ndarray) -> Six:
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz of the five parameters (see `inertia_parameters.components`)."""
    d1, d3 = np.exp(s[0]), np.exp(-s[1])
    return (
        d1,
        s[2] * s[2] * d1 + 1.0,
        s[3] * s[3] * d1 + s[4] * s[4] + d3,
        s[2] * d1,
        s[3] * d1,
        s[2] * s[3] * d1 + s[4],
    )


@numba.njit(cache=True)
def _slope(y: np.ndarray, six: Six, l: np.ndarray, mu: float, out: np.ndarray) -> None:
    """Rates of y = (q 4, w 3, r 3, v 3) with gravity-gradient torque and differential gravity (volpe2017 eq 18)."""
    out[0], out[1], out[2], out[3] = quaternion_rate(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    xx, yy, zz, xy, xz, yz = six
    tx, ty, tz = 0.0, 0.0, 0.0
    out[7], out[8], out[9] = y[10], y[11], y[12]
    out[10] = out[11] = out[12] = 0.0
    if mu > 0.0:
        out[10], out[11], out[12] = differential_gravity(mu, l[0], l[1], l[2], y[7], y[8], y[9])
        px, py, pz = l[0] + y[7], l[1] + y[8], l[2] + y[9]
        square = px * px + py * py + pz * pz
        a, b, c = to_body(y[0], y[1], y[2], y[3], px, py, pz)
        factor = 3.0 * mu / (square * square * np.sqrt(square))
        ia, ib, ic = xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c
        tx, ty, tz = factor * (b * ic - c * ib), factor * (c * ia - a * ic), factor * (a * ib - b * ia)
    out[4], out[5], out[6] = euler_acceleration(six, (y[4], y[5], y[6]), (tx, ty, tz))


@numba.njit(cache=True)
def move(
    y: np.ndarray, s: np.ndarray, h: float, steps: int, l0: np.ndarray, lm: np.ndarray, l1: np.ndarray, mu: float
) -> None:
    """y = (q, w, r, v) a time h later, in place; l0, lm, l1: the chaser at the start, middle and end [m]."""
    six = six_elements(s)
    k1, k2, k3, k4, z, l = np.empty(13), np.empty(13), np.empty(13), np.empty(13), np.empty(13), np.empty(3)
    d = h / steps
    for step in range(steps):
        for stage in range(4):
            u = (step + (0.0 if stage == 0 else (1.0 if stage == 3 else 0.5))) / steps
            for i in range(3):
                l[i] = l0[i] * (1 - u) * (1 - 2 * u) + 4 * lm[i] * u * (1 - u) + l1[i] * u * (2 * u - 1)
            if stage == 0:
                _slope(y, six, l, mu, k1)
            elif stage == 1:
                for i in range(13):
                    z[i] = y[i] + 0.5 * d * k1[i]
                _slope(z, six, l, mu, k2)
            elif stage == 2:
                for i in range(13):
                    z[i] = y[i] + 0.5 * d * k2[i]
                _slope(z, six, l, mu, k3)
            else:
                for i in range(13):
                    z[i] = y[i] + d * k3[i]
                _slope(z, six, l, mu, k4)
        for i in range(13):
            y[i] += d / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
        size = np.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3])
        for i in range(4):
            y[i] /= size


@numba.njit(cache=True)
def factor(P: np.ndarray, columns: int, L: np.ndarray) -> None:
    """The first columns of L with P = L L^T; a direction without variance gets none."""
    n = P.shape[0]
    for j in range(columns):
        pivot = P[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if pivot <= TINY * P[j, j]:
            for i in range(n):
                L[i, j] = 0.0
            L[j, j] = np.sqrt(max(TINY * P[j, j], 0.0))
            continue
        L[j, j] = np.sqrt(pivot)
        inverse = 1.0 / L[j, j]
        for i in range(j):
            L[i, j] = 0.0
        for i in range(j + 1, n):
            total = P[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * inverse


@numba.njit(cache=True)
def _point(y: np.ndarray, s: np.ndarray, L: np.ndarray, j: int, g: float, z: np.ndarray, t: np.ndarray) -> None:
    """The sigma point g standard deviations along column j: writes the motion z (13,) and the inertia t (5,)."""
    z[0], z[1], z[2], z[3] = turned(y[0], y[1], y[2], y[3], g * L[0, j], g * L[1, j], g * L[2, j])
    for i in range(3):
        z[4 + i] = y[4 + i] + g * L[3 + i, j]
        z[7 + i] = y[7 + i] + g * L[11 + i, j]
        z[10 + i] = y[10 + i] + g * L[14 + i, j]
    for i in range(5):
        t[i] = s[i] + g * L[6 + i, j]


@numba.njit(cache=True)
def _pairs(
    state: Moving, h: float, leaders: tuple[np.ndarray, np.ndarray, np.ndarray], mu: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mean a time h later (13,), and half differences and half sums (17, 17) of the sigma points about it."""
    y, s, L = state.y, state.s, state.L
    speed = np.sqrt(y[4] * y[4] + y[5] * y[5] + y[6] * y[6])
    steps = int(min(5000.0, max(1.0, np.ceil(speed * h / LARGEST_TURN))))
    z, t, c = np.empty(13), np.empty(5), y.copy()
    move(c, s, h, steps, leaders[0], leaders[1], leaders[2], mu)
    odd, even = np.zeros((BASE, BASE)), np.zeros((BASE, BASE))
    for j in range(BASE):
        for side in range(2):
            g = SPREAD if side == 0 else -SPREAD
            _point(y, s, L, j, g, z, t)
            move(z, t, h, steps, leaders[0], leaders[1], leaders[2], mu)
            turn = turn_between(c[0], c[1], c[2], c[3], z[0], z[1], z[2], z[3])
            sign = 0.5 / g
            even_share = 0.5 / SPREAD
            for i in range(BASE):
                if i < 3:
                    d = turn[i]
                elif i < 6:
                    d = z[1 + i] - c[1 + i]
                elif i < 11:
                    d = t[i - 6] - s[i - 6]
                else:
                    d = z[i - 4] - c[i - 4]
                odd[i, j] += sign * d
                even[i, j] += even_share * d
    return c, odd, even


@numba.njit(cache=True)
def predict(state: Moving, h: float, leaders: tuple[np.ndarray, np.ndarray, np.ndarray], rule: Rule) -> None:
    """State and covariance a time h later, in place; leaders: the chaser at the start, middle and end [m]."""
    y, P, L = state.y, state.P, state.L
    n = P.shape[0]
    factor(P, BASE, L)
    c, odd, even = _pairs(state, h, leaders, rule.mu)
    mean = np.zeros(BASE)
    for i in range(BASE):
        for j in range(BASE):
            mean[i] += even[i, j] / SPREAD
    for i in range(BASE):
        for k in range(i, BASE):
            total = 0.0
            for j in range(BASE):
                total += odd[i, j] * odd[k, j] + even[i, j] * even[k, j]
            P[i, k] = P[k, i] = total
        for k in range(BASE, n):
            total = 0.0
            for j in range(BASE):
                total += odd[i, j] * L[k, j]
            P[i, k] = P[k, i] = total
    y[0], y[1], y[2], y[3] = turned(c[0], c[1], c[2], c[3], mean[0], mean[1], mean[2])
    for i in range(3):
        y[4 + i] = c[4 + i] + mean[3 + i]
        y[7 + i] = c[7 + i] + mean[11 + i]
        y[10 + i] = c[10 + i] + mean[14 + i]
    for i in range(3):
        for first, second, noise in ((0, 3, rule.turn_noise), (11, 14, rule.push_noise)):
            a, b = first + i, second + i
            P[a, a] += noise * h * h * h / 3
            P[a, b] += noise * h * h / 2
            P[b, a] += noise * h * h / 2
            P[b, b] += noise * h


@numba.njit(cache=True)
def _sight(
    z: np.ndarray, f: np.ndarray, C: np.ndarray, lens: np.ndarray, first: int, seen: np.ndarray, h: np.ndarray
) -> None:
    """Predicted pixels of the seen features from number `first` on, into h (2 m,)."""
    R = np.empty((3, 3))
    matrix_of(z[0], z[1], z[2], z[3], R)
    X, Y = np.empty(3), np.empty(3)
    for i in range(first, f.shape[0]):
        if not seen[i]:
            continue
        for a in range(3):
            X[a] = z[7 + a] + R[a, 0] * f[i, 0] + R[a, 1] * f[i, 1] + R[a, 2] * f[i, 2]
        for a in range(3):
            Y[a] = C[0, a] * X[0] + C[1, a] * X[1] + C[2, a] * X[2]
        depth = max(Y[2], 1e-3)
        h[2 * i] = lens[0] * Y[0] / depth + lens[2]
        h[2 * i + 1] = lens[1] * Y[1] / depth + lens[3]


@numba.njit(cache=True)
def _seen(uv: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
    """Which features are seen, and the numbers of what is measured: 2 i + axis of a feature, 2 m of the range."""
    m = uv.shape[0]
    seen = np.zeros(m, np.bool_)
    index = np.empty(2 * m + 1, np.int64)
    count = 0
    for i in range(m):
        seen[i] = np.isfinite(uv[i, 0])
        if seen[i]:
            index[count], index[count + 1] = 2 * i, 2 * i + 1
            count += 2
    if np.isfinite(span):
        index[count] = 2 * m
        count += 1
    return seen, index[:count]


@numba.njit(cache=True)
def _innovations(state: Moving, uv: np.ndarray, span: float, C: np.ndarray, rule: Rule) -> Rows:
    """`Rows` of one epoch; P is factored into L."""
    y, s, f, P, L = state
    seen, index = _seen(uv, span)
    n, m, count = P.shape[0], f.shape[0], len(index)
    odd, even = np.zeros((n, count)), np.zeros((n, count))
    S, v = np.zeros((count, count)), np.empty(count)
    if count == 0:
        return Rows(index, odd, even, v, S)
    factor(P, n, L)
    z, t, g = y.copy(), s.copy(), f.copy()
    h0, hp, hm = np.zeros(2 * m + 1), np.zeros(2 * m + 1), np.zeros(2 * m + 1)
    _sight(y, f, C, rule.lens, 0, seen, h0)
    h0[2 * m] = np.sqrt(y[7] * y[7] + y[8] * y[8] + y[9] * y[9])
    for j in range(n):
        first = 0 if j < BASE else (j - BASE) // 3
        for side in range(2):
            amount = SPREAD if side == 0 else -SPREAD
            h = hp if side == 0 else hm
            h[:] = h0
            if j < BASE:
                _point(y, s, L, j, amount, z, t)
            for i in range(first, m):
                for a in range(3):
                    g[i, a] = f[i, a] + amount * L[BASE + 3 * i + a, j]
            _sight(z, g, C, rule.lens, first, seen, h)
            h[2 * m] = np.sqrt(z[7] * z[7] + z[8] * z[8] + z[9] * z[9])
        z[:] = y
        for c in range(count):
            k = index[c]
            odd[j, c] = 0.5 / SPREAD * (hp[k] - hm[k])
            even[j, c] = 0.5 / SPREAD * (hp[k] + hm[k] - 2.0 * h0[k])
    for c in range(count):
        k = index[c]
        mean = 0.0
        for j in range(n):
            mean += even[j, c] / SPREAD
        v[c] = (span if k == 2 * m else uv[k // 2, k % 2]) - h0[k] - mean
        for b in range(c + 1):
            total = 0.0
            for j in range(n):
                total += odd[j, c] * odd[j, b] + even[j, c] * even[j, b]
            S[c, b] = S[b, c] = total
        S[c, c] += rule.range_variance if k == 2 * m else rule.pixel_variance
    return Rows(index, odd, even, v, S)


@numba.njit(cache=True)
def _kept(rows: Rows, m: int, rule: Rule) -> np.ndarray:
    """Numbers of the rows that pass the gate; where most do not, all of them, with S widened."""
    index, v, S = rows.index, rows.value, rows.S
    count = len(index)
    ratio = np.empty(count)
    bad = 0
    for c in range(count):
        ratio[c] = v[c] * v[c] / S[c, c]
        if ratio[c] > rule.gate:
            bad += 1
    keep = np.arange(count)
    if 2 * bad > count:
        # most disagree: the filter is at fault, or the whole frame; listen, but less
        widen = np.median(ratio)
        for c in range(count):
            S[c, c] += (widen - 1.0) * (rule.range_variance if index[c] == 2 * m else rule.pixel_variance)
    elif bad > 0:
        left = 0
        for c in range(count):
            partner = c if index[c] == 2 * m else (c + 1 if index[c] % 2 == 0 else c - 1)
            if ratio[c] <= rule.gate and ratio[partner] <= rule.gate:
                keep[left] = c
                left += 1
        keep = keep[:left]
    return keep


@numba.njit(cache=True)
def _whitened(rows: Rows, keep: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cross-covariance K (N, rows) and innovation (rows,) by the factor G of their covariance, K G^-T and G^-1 v: then P
    loses the square of the first, and the step is their product."""
    n, count = L.shape[0], len(keep)
    K, A, w = np.empty((n, count)), np.empty((count, count)), np.empty(count)
    for a in range(count):
        w[a] = rows.value[keep[a]]
        for b in range(count):
            A[a, b] = rows.S[keep[a], keep[b]]
        for i in range(n):
            total = 0.0
            for j in range(i + 1):
                total += L[i, j] * rows.odd[j, keep[a]]
            K[i, a] = total
    G = np.zeros((count, count))
    factor(A, count, G)
    for a in range(count):
        inverse = 1.0 / G[a, a]
        for i in range(n):
            total = K[i, a]
            for b in range(a):
                total -= K[i, b] * G[a, b]
            K[i, a] = total * inverse
        total = w[a]
        for b in range(a):
            total -= w[b] * G[a, b]
        w[a] = total * inverse
    return K, w


@numba.njit(cache=True)
def correct(state: Moving, uv: np.ndarray, span: float, C: np.ndarray, rule: Rule, tally: np.ndarray) -> None:
    """One epoch's pixels uv (m, 2) and range, in place. tally: used, refused, sum of squares, rows."""
    y, s, f, P, L = state
    n, m = P.shape[0], f.shape[0]
    found = _innovations(state, uv, span, C, rule)
    if len(found.index) == 0:
        return
    keep = _kept(found, m, rule)
    rows = len(keep)
    tally[1] += len(found.index) - rows
    if rows == 0:
        return
    K, w = _whitened(found, keep, L)
    step = np.zeros(n)
    for i in range(n):
        for a in range(rows):
            step[i] += K[i, a] * w[a]
        for k in range(i + 1):
            total = P[i, k]
            for a in range(rows):
                total -= K[i, a] * K[k, a]
            P[i, k] = P[k, i] = total
    for a in range(rows):
        tally[2] += w[a] * w[a]
    tally[0] += rows
    tally[3] += rows
    if not np.isfinite(np.sum(step)):
        return
    y[0], y[1], y[2], y[3] = turned(y[0], y[1], y[2], y[3], step[0], step[1], step[2])
    for i in range(3):
        y[4 + i] += step[3 + i]
        y[7 + i] += step[11 + i]
        y[10 + i] += step[14 + i]
    for i in range(5):
        s[i] = min(max(s[i] + step[6 + i], -5.0), 5.0)
    for i in range(m):
        for a in range(3):
            f[i, a] += step[BASE + 3 * i + a]


@numba.njit(cache=True)
def run(
    state: Moving,
    times: np.ndarray,
    uv: np.ndarray,
    span: np.ndarray,
    camera: np.ndarray,
    chaser: np.ndarray,
    middle: np.ndarray,
    rule: Rule,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whole filter from the first epoch, whose state is changed in place.

    Args:
        state: `Moving`; rule: `Rule`. times (n,); uv (n, m, 2); span (n,) ranges; camera (n, 4) cam0 to inertial;
        chaser (n, 3), middle (n - 1, 3): the chaser at the epochs and half-way [m].

    Returns:
        out (n, 18): y and s; block (n, 17, 17): covariance without features; tally (4,).
    """
    n = len(times)
    out, block, tally = np.empty((n, 18)), np.empty((n, BASE, BASE)), np.zeros(4)
    C = np.empty((3, 3))
    for e in range(n):
        if e > 0:
            predict(state, times[e] - times[e - 1], (chaser[e - 1], middle[e - 1], chaser[e]), rule)
        matrix_of(camera[e, 0], camera[e, 1], camera[e, 2], camera[e, 3], C)
        correct(state, uv[e], span[e], C, rule, tally)
        out[e, :13] = state.y
        out[e, 13:] = state.s
        block[e] = state.P[:BASE, :BASE]
    return out, block, tally


@numba.njit(cache=True)
def trajectories(
    times: np.ndarray, y: np.ndarray, s: np.ndarray, chaser: np.ndarray, middle: np.ndarray, mu: float
) -> np.ndarray:
    """Motion (b, n, 13) at the times from b states y (b, 13) at the first of them and inertias s (b, 5)."""
    b, n = y.shape[0], len(times)
    out = np.empty((b, n, 13))
    for i in range(b):
        z = y[i].copy()
        out[i, 0] = z
        for e in range(1, n):
            h = times[e] - times[e - 1]
            speed = np.sqrt(y[0, 4] ** 2 + y[0, 5] ** 2 + y[0, 6] ** 2)
            # the same steps for all, so that differences between them are smooth
            steps = int(min(5000.0, max(1.0, np.ceil(1.2 * speed * h / LARGEST_TURN))))
            move(z, s[i], h, steps, chaser[e - 1], middle[e - 1], chaser[e], mu)
            out[i, e] = z
    return out
