"""The filter as plain loops, to be compiled by numba.

The sigma points are those of the whole state, but what is zero is not computed. With P = U^T U, rotation first in
the state: only the rows of U that touch rates, attitude and ratios need the equations of motion; the row of a feature
touches only that feature and those after it; and what moves linearly keeps its covariance exactly. Sums over pairs of
sigma points are taken as half differences and half sums, in which no weight is negative, so P never turns indefinite.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import to_body
from massprops.estimators.unscented.algebra import (
    add_pairs,
    add_rows,
    add_to_mean,
    difference,
    middle,
    take_rows,
    upper_factor,
)
from massprops.estimators.unscented.arguments import Channels, Epochs, Moving, Quaternion, Record, Residual, Rule
from massprops.estimators.unscented.components import feature_motion, image, product, turn_between, turned, unit
from massprops.estimators.unscented.prediction import bounded, offsets, perturbed, propagate

SMALL = 200_000
"""Products up to which BLAS is used: it is quicker than the loops, and keeps to one thread."""


def head_and_each(channels: Channels) -> tuple[int, int]:
    """How many measurements come before the features', and how many each feature has."""
    extras = channels.extras
    each = 2 * channels.lens.shape[0] * (2 if channels.flow else 1) + (1 if channels.disparity else 0)
    return extras[0] + extras[1] + extras[2], each


def sensor_sight(h: np.ndarray, s: Moving, extras: tuple[int, int, int], mid: Quaternion) -> None:
    """Predicted attitude (a turn from `mid`), rates and range, those in use, into h."""
    w, q, a, o = s.w, s.q, s.axes, 0
    if extras[0]:
        seen = product(q[0], q[1], q[2], q[3], a[0], a[1], a[2], a[3])
        h[0], h[1], h[2] = turn_between(mid[0], mid[1], mid[2], mid[3], seen[0], seen[1], seen[2], seen[3])
        o = 3
    if extras[1]:
        h[o], h[o + 1], h[o + 2] = to_body(a[0], a[1], a[2], a[3], w[0], w[1], w[2])
        o += 3
    if extras[2]:
        r = s.position
        h[o] = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)


def sight(
    h: np.ndarray, used: np.ndarray, first: int, s: Moving, channels: Channels, mid: Quaternion, still: bool
) -> None:
    """Predicted measurements of a state from feature `first` on (and the sensors' when it is 0), into h."""
    head, each = head_and_each(channels)
    if first == 0 and head > 0:
        sensor_sight(h, s, channels.extras, mid)
    w, q, r, v, p = s.w, s.q, s.position, s.velocity, s.features
    cams = channels.lens.shape[0]
    for i in range(first, p.shape[0]):
        if not used[i]:
            continue
        o = head + each * i
        x, y, z, dx, dy, dz = feature_motion(q[0], q[1], q[2], q[3], w[0], w[1], w[2], p[i, 0], p[i, 1], p[i, 2])
        if not still:
            dx, dy, dz = dx + v[0], dy + v[1], dz + v[2]
        x, y, z = x + r[0], y + r[1], z + r[2]
        for c in range(cams):
            eye = image(channels, c, (x, y, z), (dx, dy, dz))
            h[o + 2 * c], h[o + 2 * c + 1] = eye[0], eye[1]
            if channels.flow:
                f = o + 2 * cams + (1 if channels.disparity else 0) + 2 * c
                h[f], h[f + 1] = eye[2], eye[3]
        if channels.disparity:
            h[o + 2 * cams] = h[o + 2] - h[o]


def first_columns(index: np.ndarray, count: int, channels: Channels, features: int) -> np.ndarray:
    """(features + 1,) the first of the measurements `index` that belongs to each feature or a later one."""
    head, each = head_and_each(channels)
    start = np.zeros(features + 1, np.int64)
    at = 0
    for i in range(features + 1):
        while at < count and index[at] < head + each * i:
            at += 1
        start[i] = at
    start[0] = 0  # what is not a feature's is touched by the rows before the features
    return start


def displace(point: Moving, s: Moving, U: np.ndarray, j: int, g: float, rule: Rule, pinned: bool) -> None:
    """Writes into `point` the rotation, axes and position of the sigma point g along row j of U."""
    _, nd, tr, _ = offsets(rule)
    if j < nd:
        for i in range(3):
            point.w[i] = s.w[i] + g * U[j, i]
        a = perturbed(s.q, U, j, g, rule.additive)
        point.q[0], point.q[1], point.q[2], point.q[3] = a[0], a[1], a[2], a[3]
    if rule.axes and j < nd + 3:
        a = s.axes
        a = turned(a[0], a[1], a[2], a[3], g * U[j, nd], g * U[j, nd + 1], g * U[j, nd + 2])
        point.axes[0], point.axes[1], point.axes[2], point.axes[3] = a[0], a[1], a[2], a[3]
    if rule.moving and j < tr + 6 and not pinned:
        for i in range(3):
            point.position[i] = s.position[i] + g * U[j, tr + i]
            point.velocity[i] = s.velocity[i] + g * U[j, tr + 3 + i]


def sigma_points(
    s: Moving,
    U: np.ndarray,
    index: np.ndarray,
    used: np.ndarray,
    start: np.ndarray,
    channels: Channels,
    rule: Rule,
    pinned: bool,
) -> tuple[np.ndarray, Quaternion, np.ndarray]:
    """Measurements predicted from the mean (ny,), the attitude there, and half differences and half sums of the pairs
    of sigma points (2, N + 3, nu), whose last rows are zero."""
    n, m, nu, ny = U.shape[1], s.features.shape[0], index.shape[0], channels.group.shape[0]
    _, _, _, off = offsets(rule)
    q, a = s.q, s.axes
    mid = product(q[0], q[1], q[2], q[3], a[0], a[1], a[2], a[3])
    h0, hp, hm = np.zeros(ny), np.zeros(ny), np.zeros(ny)
    place = channels.reference if pinned else s.position
    base = Moving(s.w, q, s.k, a, place, s.velocity, s.features, s.P)
    sight(h0, used, 0, base, channels, mid, pinned)
    both = np.zeros((2, n + 3, nu))
    odd, even = both[0], both[1]
    point = Moving(s.w.copy(), q.copy(), s.k, a.copy(), place.copy(), s.velocity.copy(), s.features.copy(), s.P)
    half = 0.5 / rule.gamma
    for j in range(n):
        f0 = 0 if j < off else (j - off) // 3
        for side in range(2):
            g = rule.gamma if side == 0 else -rule.gamma
            h = hp if side == 0 else hm
            if j < off:
                displace(point, base, U, j, g, rule, pinned)
            for i in range(f0, m):
                for c in range(3):
                    point.features[i, c] = s.features[i, c] + g * U[j, off + 3 * i + c]
            sight(h, used, f0, point, channels, mid, pinned)
        for i in range(3):
            point.w[i], point.q[i], point.axes[i] = s.w[i], q[i], a[i]
            point.position[i], point.velocity[i] = place[i], s.velocity[i]
        point.q[3], point.axes[3] = q[3], a[3]
        if nu == ny:
            difference(odd, even, j, start[f0], nu, hp, hm, h0, half)
        else:
            for c in range(start[f0], nu):
                i = index[c]
                odd[j, c] = half * (hp[i] - hm[i])
                even[j, c] = half * (hp[i] + hm[i] - 2.0 * h0[i])
        if j >= off:
            for c in range(3):
                point.features[f0, c] = s.features[f0, c]
    return h0, mid, both


def residual_of(
    both: np.ndarray, index: np.ndarray, h0: np.ndarray, value: np.ndarray, variance: np.ndarray, rule: Rule
) -> Residual:
    """What was measured less what the sigma points foresee, with its variance."""
    odd, even = both[0], both[1]
    nu = odd.shape[1]
    mean, spread = np.zeros(nu), np.zeros(nu)
    off, noise = np.empty(nu), np.empty(nu)
    for j in range(odd.shape[0] - 3):
        add_to_mean(mean, spread, odd, even, j, rule.gate > 0.0)
    for c in range(nu):
        mean[c] *= 1.0 / rule.gamma
        i = index[c]
        off[c] = value[i] - h0[i] - mean[c]
        spread[c] += rule.excess * mean[c] * mean[c]
        noise[c] = variance[i]
    return Residual(off, mean, spread, noise)


def gated(r: Residual, both: np.ndarray, index: np.ndarray, group: np.ndarray, gate: float) -> tuple[int, float]:
    """How many measurements pass, moved to the front, and the factor on their noise."""
    odd, even = both[0], both[1]
    nu, bad = index.shape[0], 0
    ratio = np.empty(nu)
    for c in range(nu):
        ratio[c] = r.value[c] * r.value[c] / (r.spread[c] + r.noise[c])
        if ratio[c] > gate * gate:
            bad += 1
    if 2 * bad > nu:
        # most measurements disagree: the filter is at fault, or the whole frame; listen, but less
        return nu, max(1.0, middle(ratio))
    if bad == 0:
        return nu, 1.0
    wrong = np.zeros(group[group.shape[0] - 1] + 1, np.bool_)
    for c in range(nu):
        if ratio[c] > gate * gate:
            wrong[group[index[c]]] = True
    keep = 0
    for c in range(nu):
        if not wrong[group[index[c]]]:
            index[keep], r.value[keep], r.noise[keep], r.mean[keep] = index[c], r.value[c], r.noise[c], r.mean[c]
            for j in range(odd.shape[0] - 3):
                odd[j, keep], even[j, keep] = odd[j, c], even[j, c]
            keep += 1
    return keep, 1.0


def factored(
    both: np.ndarray, U: np.ndarray, start: np.ndarray, r: Residual, nu: int, inflate: float, rule: Rule
) -> np.ndarray:
    """The factor of the innovations' covariance S, and what it makes of cross-covariance and innovation (nu, nu + N + 1).

    [S, cross-covariance, innovation] is summed row by row, four sigma-point pairs at a time; zero rows make the count
    even.
    """
    odd, even = both[0], both[1]
    n, off = U.shape[1], offsets(rule)[3]
    width = nu + n + 1
    T = np.zeros((nu, width))
    for c in range(nu):
        f = rule.excess * r.mean[c]
        for b in range(c, nu):
            T[c, b] = f * r.mean[b]
        T[c, c] += inflate * r.noise[c]
        T[c, width - 1] = r.value[c]
    j = 0
    if blas_is_quicker(both, nu):
        pairs = both.reshape(2 * n + 6, nu)
        square, cross = np.dot(pairs.T, pairs), np.dot(odd.T, U)
        for c in range(nu):
            for b in range(c, nu):
                T[c, b] += square[c, b]
            for b in range(n):
                T[c, nu + b] = cross[c, b]
        j = n
    while j < n:
        begin = start[0 if j < off else (j - off) // 3]
        for c in range(begin, nu):
            add_pairs(T, c, nu - c, odd, even, j)
            add_rows(T, c, nu + j, n - j, U, j, j, (odd[j, c], odd[j + 1, c], odd[j + 2, c], odd[j + 3, c]))
        j += 4
    upper_factor(T, nu)
    return T


def blas_is_quicker(both: np.ndarray, nu: int) -> bool:
    """Whether all measurements stand side by side and are few."""
    return nu == both.shape[2] and 2 * (both.shape[1] - 3) * nu * nu <= SMALL


def reduce_covariance(P: np.ndarray, T: np.ndarray, small: bool) -> None:
    """Takes from P what the measurements tell."""
    n, nu = P.shape[0], T.shape[0]
    if small:
        gained = T[:, nu : nu + n].copy()
        square = np.dot(gained.T, gained)
        for a in range(n):
            for b in range(a, n):
                P[a, b] -= square[a, b]
    for a in range(0 if small else n):
        c = 0
        g = nu + a
        while c + 8 <= nu:
            take_rows(P, a, a, n - a, T, c, g, g)
            c += 8
        if c + 4 <= nu:
            add_rows(P, a, a, n - a, T, c, g, (-T[c, g], -T[c + 1, g], -T[c + 2, g], -T[c + 3, g]))
            c += 4
        while c < nu:
            f = T[c, nu + a]
            for b in range(a, n):
                P[a, b] -= f * T[c, nu + b]
            c += 1
    for a in range(n):
        P[a, a] = max(P[a, a], 1e-290)
        for b in range(a):
            P[a, b] = P[b, a]


def add_step(s: Moving, step: np.ndarray, rule: Rule) -> None:
    """The state moved by an error (N,), in place."""
    na, nd, tr, off = offsets(rule)
    q, a = s.q, s.axes
    for i in range(3):
        s.w[i] += step[i]
    if rule.additive:
        u = unit(q[0] + step[3], q[1] + step[4], q[2] + step[5], q[3] + step[6])
    else:
        u = turned(q[0], q[1], q[2], q[3], step[3], step[4], step[5])
    q[0], q[1], q[2], q[3] = u[0], u[1], u[2], u[3]
    for i in range(2):
        s.k[i] = min(max(s.k[i] + step[3 + na + i], -5.0), 5.0)
    if rule.axes:
        u = turned(a[0], a[1], a[2], a[3], step[nd], step[nd + 1], step[nd + 2])
        a[0], a[1], a[2], a[3] = u[0], u[1], u[2], u[3]
    if rule.moving:
        for i in range(3):
            s.position[i] += step[tr + i]
            s.velocity[i] += step[tr + 3 + i]
    for i in range(s.features.shape[0]):
        for c in range(3):
            s.features[i, c] += step[off + 3 * i + c]


def measured(z: np.ndarray, variance: np.ndarray, channels: Channels, features: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the measurements there are (nu,), and which features have any."""
    head, each = head_and_each(channels)
    index = np.empty(z.shape[0], np.int64)
    used = np.zeros(features, np.bool_)
    nu = 0
    for c in range(z.shape[0]):
        if np.isfinite(z[c]) and variance[c] > 0.0:
            index[nu] = c
            nu += 1
            if c >= head:
                used[(c - head) // each] = True
    return index[:nu], used


def correct(s: Moving, epochs: Epochs, t: int, channels: Channels, rule: Rule, tally: np.ndarray) -> None:
    """The measurements of epoch t, in place. tally: normalised innovation squared, used, gated."""
    P, m = s.P, s.features.shape[0]
    value, variance = epochs.z[t], epochs.variance[t]
    index, used = measured(value, variance, channels, m)
    nu = index.shape[0]
    if nu == 0:
        return
    start = first_columns(index, nu, channels, m)
    n = P.shape[0]
    U = np.zeros((n + 3, n))
    for i in range(n):
        for c in range(n):
            U[i, c] = P[i, c]
    upper_factor(U, n)
    h0, mid, both = sigma_points(s, U, index, used, start, channels, rule, epochs.pinned[t])
    if channels.extras[0]:
        a, value = epochs.attitude[t], value.copy()
        value[0], value[1], value[2] = turn_between(mid[0], mid[1], mid[2], mid[3], a[0], a[1], a[2], a[3])
    r = residual_of(both, index, h0, value, variance, rule)
    inflate = 1.0
    if rule.gate > 0.0:
        keep, inflate = gated(r, both, index, channels.group, rule.gate)
        if keep < nu:
            tally[2] += nu - keep
            nu = keep
            start = first_columns(index, nu, channels, m)
            if nu == 0:
                return
    T = factored(both, U, start, r, nu, inflate, rule)
    step = np.zeros(n)
    nis = 0.0
    for c in range(nu):
        f = T[c, nu + n]
        nis += f * f
        for b in range(n):
            step[b] += f * T[c, nu + b]
    size = nis
    for i in range(n):
        size += step[i] * step[i]
    if not np.isfinite(size):
        return
    tally[0] += nis
    tally[1] += nu
    reduce_covariance(P, T, blas_is_quicker(both, nu))
    add_step(s, step, rule)
    bounded(s.w, P, offsets(rule)[0])


def run_loop(s: Moving, epochs: Epochs, channels: Channels, rule: Rule, record: Record) -> None:
    """All epochs; the state ends at the last one."""
    P, nb, mean = s.P, record.block.shape[1], record.mean
    for t in range(epochs.dt.shape[0]):
        if epochs.dt[t] > 0.0:
            propagate(s, epochs.dt[t], epochs.transition[t], epochs.spin[t], rule)
        correct(s, epochs, t, channels, rule, record.tally[t])
        for i in range(3):
            mean[t, i], mean[t, 13 + i], mean[t, 16 + i] = s.w[i], s.position[i], s.velocity[i]
        for i in range(4):
            mean[t, 3 + i], mean[t, 9 + i] = s.q[i], s.axes[i]
        mean[t, 7], mean[t, 8] = s.k[0], s.k[1]
        for i in range(P.shape[0]):
            record.sigma[t, i] = np.sqrt(P[i, i])
        for i in range(nb):
            for j in range(nb):
                record.block[t, i, j] = P[i, j]
