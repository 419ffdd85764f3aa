"""The filter as plain loops, to be compiled by numba; `arrays` gives the same numbers with numpy alone.

The sigma points are those of the whole state, but what is zero is not computed. With P = U^T U, rotation first in
the state: only the rows of U that touch rates, attitude and ratios need the equations of motion; the row of a feature
touches only that feature and those after it; and what moves linearly keeps its covariance exactly. Sums over pairs of
sigma points are taken as half differences and half sums, in which no weight is negative, so P never turns indefinite.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import to_body
from massprops.estimators.unscented.components import (
    feature_motion,
    image,
    torque_free,
    turn_between,
    turned,
    unit,
)

LOST = 1e-13
"""A pivot below this share of its diagonal is rounding, and is held there."""
WIDEST_RATE, WIDEST_TURN, WIDEST_RATIO = 10.0, 3.0, 2.0
"""1-sigma of rates [rad/s], attitude [rad] and k beyond which nothing is known of them: wider is not carried."""
FASTEST = 100.0
"""Largest rate that a mean is allowed to reach [rad/s]."""
BEYOND = 1e9
"""Sum of squares of rates and turns [rad, s] of a propagation that has left all meaning."""


def add_rows(t, A, k, begin, f0, f1, f2, f3):  # type: ignore[no-untyped-def]
    """t += f0 A[k, begin:] + f1 A[k + 1, begin:] + f2 ... + f3 ..., as long as t: four rows in one pass."""
    n = t.shape[0]
    a, b = A[k, begin : begin + n], A[k + 1, begin : begin + n]
    c, d = A[k + 2, begin : begin + n], A[k + 3, begin : begin + n]
    for i in range(n):
        t[i] += f0 * a[i] + f1 * b[i] + f2 * c[i] + f3 * d[i]


def take_rows(t, A, k, begin, column):  # type: ignore[no-untyped-def]
    """t -= sum over eight rows j from k of A[j, column] A[j, begin:], as long as t."""
    n = t.shape[0]
    a, b, c, d = A[k, begin : begin + n], A[k + 1, begin : begin + n], A[k + 2, begin : begin + n], A[k + 3, begin : begin + n]
    e, f, g, h = A[k + 4, begin : begin + n], A[k + 5, begin : begin + n], A[k + 6, begin : begin + n], A[k + 7, begin : begin + n]
    f0, f1, f2, f3 = A[k, column], A[k + 1, column], A[k + 2, column], A[k + 3, column]
    g0, g1, g2, g3 = A[k + 4, column], A[k + 5, column], A[k + 6, column], A[k + 7, column]
    for i in range(n):
        t[i] -= f0 * a[i] + f1 * b[i] + f2 * c[i] + f3 * d[i] + g0 * e[i] + g1 * f[i] + g2 * g[i] + g3 * h[i]


def add_pairs(t, A, B, k, begin, column):  # type: ignore[no-untyped-def]
    """t += sum over four rows j from k of A[j, column] A[j, begin:] + B[j, column] B[j, begin:]."""
    n = t.shape[0]
    a, b = A[k, begin : begin + n], A[k + 1, begin : begin + n]
    c, d = A[k + 2, begin : begin + n], A[k + 3, begin : begin + n]
    e, f = B[k, begin : begin + n], B[k + 1, begin : begin + n]
    g, h = B[k + 2, begin : begin + n], B[k + 3, begin : begin + n]
    f0, f1, f2, f3 = A[k, column], A[k + 1, column], A[k + 2, column], A[k + 3, column]
    g0, g1, g2, g3 = B[k, column], B[k + 1, column], B[k + 2, column], B[k + 3, column]
    for i in range(n):
        t[i] += f0 * a[i] + f1 * b[i] + f2 * c[i] + f3 * d[i] + g0 * e[i] + g1 * f[i] + g2 * g[i] + g3 * h[i]


def upper_factor(T, rows):  # type: ignore[no-untyped-def]
    """First `rows` rows of U with A = U^T U, written over T = [A, B] with zeros below the diagonal; never fails.

    Columns beyond the square become U^-T B.
    """
    for i in range(rows):
        original = T[i, i]
        row = T[i, i:]
        k = 0
        while k + 8 <= i:
            take_rows(row, T, k, i, i)
            k += 8
        if k + 4 <= i:
            add_rows(row, T, k, i, -T[k, i], -T[k + 1, i], -T[k + 2, i], -T[k + 3, i])
            k += 4
        while k < i:
            f, other = T[k, i], T[k, i:]
            for c in range(row.shape[0]):
                row[c] -= f * other[c]
            k += 1
        pivot = np.sqrt(max(T[i, i], LOST * original, 1e-290))
        inverse = 1.0 / pivot
        for c in range(row.shape[0]):
            row[c] *= inverse
        T[i, i] = pivot
        for c in range(i):
            T[i, c] = 0.0


def perturbed(q, ax, ay, az, aw, additive):  # type: ignore[no-untyped-def]
    """A sigma point's attitude: turned, or with the four components added (aw, ax, ay, az)."""
    if additive:
        return unit(q[0] + aw, q[1] + ax, q[2] + ay, q[3] + az)
    return turned(q[0], q[1], q[2], q[3], ax, ay, az)


def bounded(w, P, na):  # type: ignore[no-untyped-def]
    """Holds rates and covariance where a long time without measurements would take them past all meaning."""
    speed = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    if not speed <= FASTEST:
        for i in range(3):
            w[i] = w[i] * (FASTEST / speed) if np.isfinite(w[i]) and np.isfinite(speed) else 0.0
    for i in range(5 + na):
        widest = WIDEST_RATE if i < 3 else (WIDEST_TURN if i < 3 + na else WIDEST_RATIO)
        if P[i, i] > widest * widest:
            f = widest / np.sqrt(P[i, i])
            P[i] *= f
            P[:, i] *= f


def propagate(w, q, k, s, r, v, P, dt, F, spin, Q, largest_turn, gamma, excess, additive, axes, moving):  # type: ignore[no-untyped-def]
    """State and covariance dt later, in place."""
    n = P.shape[0]
    na = 4 if additive else 3
    nd, nf = 5 + na, 3 + na
    speed = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2) + gamma * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2])
    # where the attitude is lost there is no accuracy to keep
    most = 50 if P[3, 3] > 0.25 * WIDEST_TURN * WIDEST_TURN else 10000
    steps = min(max(1, int(np.ceil(speed * abs(dt) / largest_turn))), most)
    U = P.copy()
    upper_factor(U, nd)
    c0, c1, c2, c3, c4, c5, c6 = torque_free(w[0], w[1], w[2], q[0], q[1], q[2], q[3], k[0], k[1], dt, steps)
    odd, even = np.zeros((nd, nf)), np.zeros((nd, nf))
    for j in range(nd):
        for side in range(2):
            g = gamma if side == 0 else -gamma
            if additive:
                p0, p1, p2, p3 = perturbed(q, g * U[j, 4], g * U[j, 5], g * U[j, 6], g * U[j, 3], True)
            else:
                p0, p1, p2, p3 = perturbed(q, g * U[j, 3], g * U[j, 4], g * U[j, 5], 0.0, False)
            x0, x1, x2, p0, p1, p2, p3 = torque_free(
                w[0] + g * U[j, 0],
                w[1] + g * U[j, 1],
                w[2] + g * U[j, 2],
                p0,
                p1,
                p2,
                p3,
                k[0] + g * U[j, 3 + na],
                k[1] + g * U[j, 4 + na],
                dt,
                steps,
            )
            half = 0.5 / gamma
            sign = half if side == 0 else -half
            d = (x0 - c0, x1 - c1, x2 - c2)
            for i in range(3):
                odd[j, i] += sign * d[i]
                even[j, i] += half * d[i]
            if additive:
                f = (p0 - c3, p1 - c4, p2 - c5, p3 - c6)
                for i in range(4):
                    odd[j, 3 + i] += sign * f[i]
                    even[j, 3 + i] += half * f[i]
            else:
                a = turn_between(c3, c4, c5, c6, p0, p1, p2, p3)
                for i in range(3):
                    odd[j, 3 + i] += sign * a[i]
                    even[j, 3 + i] += half * a[i]
    mean = np.zeros(nf)
    size = c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3 + c4 * c4 + c5 * c5 + c6 * c6
    for j in range(nd):
        for i in range(nf):
            mean[i] += even[j, i] / gamma
            size += odd[j, i] * odd[j, i] + even[j, i] * even[j, i]
    if not size < BEYOND:
        # a motion beyond what can be integrated: the state stands still and its doubt grows
        for i in range(n):
            P[i, i] += Q[i] * dt
        for i in range(3):
            w[i] *= 0.5
        bounded(w, P, na)
        return
    for a in range(nf):
        for b in range(a, nf):
            total = excess * mean[a] * mean[b]
            for j in range(nd):
                total += odd[j, a] * odd[j, b] + even[j, a] * even[j, b]
            P[a, b] = total
        for b in range(nf, n):
            total = 0.0
            for j in range(min(nd, b + 1)):
                total += odd[j, a] * U[j, b]
            P[a, b] = total
    # attitude is now carried in the turned frame, rates and attitude first
    if additive:
        u = unit(c3 + mean[3], c4 + mean[4], c5 + mean[5], c6 + mean[6])
    else:
        u = turned(c3, c4, c5, c6, mean[3], mean[4], mean[5])
    w[0], w[1], w[2] = c0 + mean[0], c1 + mean[1], c2 + mean[2]
    q[0], q[1], q[2], q[3] = u[0], u[1], u[2], u[3]
    if spin[1] != 0.0 or spin[2] != 0.0 or spin[3] != 0.0:
        q0 = spin[0] * q[0] - spin[1] * q[1] - spin[2] * q[2] - spin[3] * q[3]
        q1 = spin[0] * q[1] + spin[1] * q[0] + spin[2] * q[3] - spin[3] * q[2]
        q2 = spin[0] * q[2] - spin[1] * q[3] + spin[2] * q[0] + spin[3] * q[1]
        q3 = spin[0] * q[3] + spin[1] * q[2] - spin[2] * q[1] + spin[3] * q[0]
        q[0], q[1], q[2], q[3] = q0, q1, q2, q3
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a]
    if moving:
        t = nd + (3 if axes else 0)
        old = np.empty(6)
        old[:3], old[3:] = r, v
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += F[i, j] * old[j]
            if i < 3:
                r[i] = total
            else:
                v[i - 3] = total
        rows = P[t : t + 6].copy()
        for i in range(6):
            for c in range(n):
                total = 0.0
                for j in range(6):
                    total += F[i, j] * rows[j, c]
                P[t + i, c] = total
        columns = P[:, t : t + 6].copy()
        for c in range(n):
            for i in range(6):
                total = 0.0
                for j in range(6):
                    total += columns[c, j] * F[i, j]
                P[c, t + i] = total
    for i in range(n):
        P[i, i] += Q[i] * dt
    bounded(w, P, na)


def sight(  # type: ignore[no-untyped-def]
    h, used, first, w, q, s, r, v, p, K, RC, TC, disparity, flow, extras, mid, still
):
    """Predicted measurements from feature `first` on (and the extras when it is 0), into h."""
    e = extras[0] + extras[1] + extras[2]
    if first == 0 and e > 0:
        o = 0
        if extras[0]:
            seen = (
                q[0] * s[0] - q[1] * s[1] - q[2] * s[2] - q[3] * s[3],
                q[0] * s[1] + q[1] * s[0] + q[2] * s[3] - q[3] * s[2],
                q[0] * s[2] - q[1] * s[3] + q[2] * s[0] + q[3] * s[1],
                q[0] * s[3] + q[1] * s[2] - q[2] * s[1] + q[3] * s[0],
            )
            a = turn_between(mid[0], mid[1], mid[2], mid[3], seen[0], seen[1], seen[2], seen[3])
            h[0], h[1], h[2] = a[0], a[1], a[2]
            o = 3
        if extras[1]:
            a = to_body(s[0], s[1], s[2], s[3], w[0], w[1], w[2])
            h[o], h[o + 1], h[o + 2] = a[0], a[1], a[2]
            o += 3
        if extras[2]:
            h[o] = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
    cams = K.shape[0]
    per = 2 * cams * (2 if flow else 1) + (1 if disparity else 0)
    for i in range(first, p.shape[0]):
        if not used[i]:
            continue
        o = extras[0] + extras[1] + extras[2] + per * i
        x, y, z, dx, dy, dz = feature_motion(
            q[0], q[1], q[2], q[3], w[0], w[1], w[2], p[i, 0], p[i, 1], p[i, 2]
        )
        if not still:
            dx, dy, dz = dx + v[0], dy + v[1], dz + v[2]
        x, y, z = x + r[0], y + r[1], z + r[2]
        for c in range(cams):
            eye = image(
                K[c, 0], K[c, 1], K[c, 2], K[c, 3], RC[c], TC[c, 0], TC[c, 1], TC[c, 2], x, y, z, dx, dy, dz
            )
            h[o + 2 * c], h[o + 2 * c + 1] = eye[0], eye[1]
            if flow:
                f = o + 2 * cams + (1 if disparity else 0) + 2 * c
                h[f], h[f + 1] = eye[2], eye[3]
        if disparity:
            h[o + 2 * cams] = h[o + 2] - h[o]


def correct(  # type: ignore[no-untyped-def]
    w, q, k, s, r, v, p, P, z, var, att, pinned, reference, K, RC, TC, group,
    disparity, flow, extras, gamma, excess, gate, additive, axes, moving, tally,
):  # fmt: skip
    """One epoch's measurements, in place. tally: normalised innovation squared, used, gated."""
    n, m = P.shape[0], p.shape[0]
    na = 4 if additive else 3
    nd = 5 + na
    ax = nd
    tr = nd + (3 if axes else 0)
    off = tr + (6 if moving else 0)
    e = extras[0] + extras[1] + extras[2]
    ny = z.shape[0]
    cams = K.shape[0]
    per = 2 * cams * (2 if flow else 1) + (1 if disparity else 0)
    index = np.empty(ny, np.int64)
    used = np.zeros(m, np.bool_)
    nu = 0
    for c in range(ny):
        if np.isfinite(z[c]) and var[c] > 0.0:
            index[nu] = c
            nu += 1
            if c >= e:
                used[(c - e) // per] = True
    if nu == 0:
        return
    start = np.zeros(m + 1, np.int64)
    count = 0
    for i in range(m + 1):
        while count < nu and index[count] < e + per * i:
            count += 1
        start[i] = count
    start[0] = 0  # what is not a feature's is touched by the rows before the features
    U = np.zeros((n + 3, n))
    U[:n] = P
    upper_factor(U, n)
    mid = np.empty(4)
    mid[0] = q[0] * s[0] - q[1] * s[1] - q[2] * s[2] - q[3] * s[3]
    mid[1] = q[0] * s[1] + q[1] * s[0] + q[2] * s[3] - q[3] * s[2]
    mid[2] = q[0] * s[2] - q[1] * s[3] + q[2] * s[0] + q[3] * s[1]
    mid[3] = q[0] * s[3] + q[1] * s[2] - q[2] * s[1] + q[3] * s[0]
    h0, hp, hm = np.zeros(ny), np.zeros(ny), np.zeros(ny)
    place, pace = r.copy(), v.copy()
    if pinned:
        place[:] = reference
    sight(h0, used, 0, w, q, s, place, pace, p, K, RC, TC, disparity, flow, extras, mid, pinned)
    odd, even = np.zeros((n + 3, nu)), np.zeros((n + 3, nu))
    w1, q1, s1, r1, v1, p1 = w.copy(), q.copy(), s.copy(), place.copy(), pace.copy(), p.copy()
    for j in range(n):
        f0 = 0 if j < off else (j - off) // 3
        for side in range(2):
            g = gamma if side == 0 else -gamma
            h = hp if side == 0 else hm
            if j < nd:
                for i in range(3):
                    w1[i] = w[i] + g * U[j, i]
                if additive:
                    a = perturbed(q, g * U[j, 4], g * U[j, 5], g * U[j, 6], g * U[j, 3], True)
                else:
                    a = perturbed(q, g * U[j, 3], g * U[j, 4], g * U[j, 5], 0.0, False)
                q1[0], q1[1], q1[2], q1[3] = a[0], a[1], a[2], a[3]
            if axes and j < ax + 3:
                a = turned(s[0], s[1], s[2], s[3], g * U[j, ax], g * U[j, ax + 1], g * U[j, ax + 2])
                s1[0], s1[1], s1[2], s1[3] = a[0], a[1], a[2], a[3]
            if moving and j < tr + 6 and not pinned:
                for i in range(3):
                    r1[i] = r[i] + g * U[j, tr + i]
                    v1[i] = v[i] + g * U[j, tr + 3 + i]
            for i in range(f0, m):
                for c in range(3):
                    p1[i, c] = p[i, c] + g * U[j, off + 3 * i + c] if off + 3 * i + c >= j else p[i, c]
            sight(h, used, f0, w1, q1, s1, r1, v1, p1, K, RC, TC, disparity, flow, extras, mid, pinned)
        w1[:], q1[:], s1[:], r1[:], v1[:] = w, q, s, place, pace
        half = 0.5 / gamma
        for c in range(start[f0], nu):
            i = index[c]
            odd[j, c] = half * (hp[i] - hm[i])
            even[j, c] = half * (hp[i] + hm[i] - 2.0 * h0[i])
        if j >= off:
            for c in range(3):
                p1[f0, c] = p[f0, c]
    mean, nu_vector, spread = np.zeros(nu), np.zeros(nu), np.zeros(nu)
    for j in range(n):
        f0 = 0 if j < off else (j - off) // 3
        for c in range(start[f0], nu):
            mean[c] += even[j, c] / gamma
            spread[c] += odd[j, c] * odd[j, c] + even[j, c] * even[j, c]
    if extras[0]:
        seen = turn_between(mid[0], mid[1], mid[2], mid[3], att[0], att[1], att[2], att[3])
    else:
        seen = (0.0, 0.0, 0.0)
    noise = np.empty(nu)
    for c in range(nu):
        i = index[c]
        value = seen[i] if (extras[0] and i < 3) else z[i]
        nu_vector[c] = value - h0[i] - mean[c]
        spread[c] += excess * mean[c] * mean[c]
        noise[c] = var[i]
    inflate = 1.0
    if gate > 0.0:
        ratio = np.empty(nu)
        bad = 0
        for c in range(nu):
            ratio[c] = nu_vector[c] * nu_vector[c] / (spread[c] + noise[c])
            if ratio[c] > gate * gate:
                bad += 1
        if 2 * bad > nu:
            # most measurements disagree: the filter is at fault, or the whole frame; listen, but less
            inflate = max(1.0, np.median(ratio))
        elif bad > 0:
            wrong = np.zeros(np.max(group) + 1, np.bool_)
            for c in range(nu):
                if ratio[c] > gate * gate:
                    wrong[group[index[c]]] = True
            keep = 0
            for c in range(nu):
                if not wrong[group[index[c]]]:
                    index[keep], nu_vector[keep], noise[keep], mean[keep] = index[c], nu_vector[c], noise[c], mean[c]
                    for j in range(n):
                        odd[j, keep], even[j, keep] = odd[j, c], even[j, c]
                    keep += 1
            tally[2] += nu - keep
            nu = keep
            count = 0
            for i in range(m + 1):
                while count < nu and index[count] < e + per * i:
                    count += 1
                start[i] = count
            start[0] = 0
            if nu == 0:
                return
    # [S, cross-covariance, innovation] row by row, four sigma-point pairs at a time; zero rows make the count even
    width = nu + n + 1
    T = np.zeros((nu, width))
    for c in range(nu):
        f = excess * mean[c]
        for b in range(c, nu):
            T[c, b] = f * mean[b]
        T[c, c] += inflate * noise[c]
        T[c, width - 1] = nu_vector[c]
    j = 0
    while j < n:
        begin = start[0 if j < off else (j - off) // 3]
        for c in range(begin, nu):
            add_pairs(T[c, c:nu], odd, even, j, c, c)
            add_rows(T[c, nu + j : nu + n], U, j, j, odd[j, c], odd[j + 1, c], odd[j + 2, c], odd[j + 3, c])
        j += 4
    upper_factor(T, nu)
    step = np.zeros(n)
    nis = 0.0
    for c in range(nu):
        f = T[c, width - 1]
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
    for a in range(n):
        c = 0
        g = nu + a
        while c + 8 <= nu:
            take_rows(P[a, a:], T, c, g, g)
            c += 8
        if c + 4 <= nu:
            add_rows(P[a, a:], T, c, g, -T[c, g], -T[c + 1, g], -T[c + 2, g], -T[c + 3, g])
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
    for i in range(3):
        w[i] += step[i]
    if additive:
        u = unit(q[0] + step[3], q[1] + step[4], q[2] + step[5], q[3] + step[6])
    else:
        u = turned(q[0], q[1], q[2], q[3], step[3], step[4], step[5])
    q[0], q[1], q[2], q[3] = u[0], u[1], u[2], u[3]
    for i in range(2):
        k[i] = min(max(k[i] + step[3 + na + i], -5.0), 5.0)
    if axes:
        u = turned(s[0], s[1], s[2], s[3], step[ax], step[ax + 1], step[ax + 2])
        s[0], s[1], s[2], s[3] = u[0], u[1], u[2], u[3]
    if moving:
        for i in range(3):
            r[i] += step[tr + i]
            v[i] += step[tr + 3 + i]
    for i in range(m):
        for c in range(3):
            p[i, c] += step[off + 3 * i + c]
    bounded(w, P, na)


def run_loop(  # type: ignore[no-untyped-def]
    w, q, k, s, r, v, p, P, dt, F, spin, z, var, att, pinned, reference, K, RC, TC, group, Q,
    disparity, flow, extras, gamma, excess, gate, largest_turn, additive, axes, moving,
    mean_out, sigma_out, block_out, tally_out,
):  # fmt: skip
    """All epochs; the state's arrays end at the last one."""
    n = P.shape[0]
    nb = block_out.shape[1]
    for t in range(dt.shape[0]):
        if dt[t] > 0.0:
            propagate(
                w, q, k, s, r, v, P, dt[t], F[t], spin[t], Q, largest_turn, gamma, excess, additive, axes, moving
            )  # fmt: skip
        correct(
            w, q, k, s, r, v, p, P, z[t], var[t], att[t], pinned[t], reference, K, RC, TC, group,
            disparity, flow, extras, gamma, excess, gate, additive, axes, moving, tally_out[t],
        )  # fmt: skip
        mean_out[t, 0:3], mean_out[t, 3:7], mean_out[t, 7:9] = w, q, k
        mean_out[t, 9:13], mean_out[t, 13:16], mean_out[t, 16:19] = s, r, v
        for i in range(n):
            sigma_out[t, i] = np.sqrt(P[i, i])
        block_out[t] = P[:nb, :nb]
