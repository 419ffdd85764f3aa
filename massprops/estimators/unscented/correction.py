"""The filter as plain loops, to be compiled by numba; `arrays` gives the same numbers with numpy alone.

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
from massprops.estimators.unscented.components import feature_motion, image, turn_between, turned, unit
from massprops.estimators.unscented.prediction import bounded, perturbed, propagate

SMALL = 200_000
"""Products up to which BLAS is used: it is quicker than the loops, and keeps to one thread."""


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
        x, y, z, dx, dy, dz = feature_motion(q[0], q[1], q[2], q[3], w[0], w[1], w[2], p[i, 0], p[i, 1], p[i, 2])
        if not still:
            dx, dy, dz = dx + v[0], dy + v[1], dz + v[2]
        x, y, z = x + r[0], y + r[1], z + r[2]
        for c in range(cams):
            eye = image(K[c, 0], K[c, 1], K[c, 2], K[c, 3], RC[c], TC[c, 0], TC[c, 1], TC[c, 2], x, y, z, dx, dy, dz)
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
    for i in range(n):
        for c in range(n):
            U[i, c] = P[i, c]
    upper_factor(U, n)
    mid = np.empty(4)
    mid[0] = q[0] * s[0] - q[1] * s[1] - q[2] * s[2] - q[3] * s[3]
    mid[1] = q[0] * s[1] + q[1] * s[0] + q[2] * s[3] - q[3] * s[2]
    mid[2] = q[0] * s[2] - q[1] * s[3] + q[2] * s[0] + q[3] * s[1]
    mid[3] = q[0] * s[3] + q[1] * s[2] - q[2] * s[1] + q[3] * s[0]
    h0, hp, hm = np.zeros(ny), np.zeros(ny), np.zeros(ny)
    place, pace = reference if pinned else r, v
    sight(h0, used, 0, w, q, s, place, pace, p, K, RC, TC, disparity, flow, extras, mid, pinned)
    both = np.zeros((2, n + 3, nu))
    odd, even = both[0], both[1]
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
                    p1[i, c] = p[i, c] + g * U[j, off + 3 * i + c]
            sight(h, used, f0, w1, q1, s1, r1, v1, p1, K, RC, TC, disparity, flow, extras, mid, pinned)
        for i in range(3):
            w1[i], q1[i], s1[i], r1[i], v1[i] = w[i], q[i], s[i], place[i], pace[i]
        q1[3], s1[3] = q[3], s[3]
        half = 0.5 / gamma
        if nu == ny:
            difference(odd, even, j, start[f0], nu, hp, hm, h0, half)
        else:
            for c in range(start[f0], nu):
                i = index[c]
                odd[j, c] = half * (hp[i] - hm[i])
                even[j, c] = half * (hp[i] + hm[i] - 2.0 * h0[i])
        if j >= off:
            for c in range(3):
                p1[f0, c] = p[f0, c]
    mean, nu_vector, spread = np.zeros(nu), np.zeros(nu), np.zeros(nu)
    for j in range(n):
        add_to_mean(mean, spread, odd, even, j, gate > 0.0)
    for c in range(nu):
        mean[c] *= 1.0 / gamma
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
            inflate = max(1.0, middle(ratio))
        elif bad > 0:
            wrong = np.zeros(group[group.shape[0] - 1] + 1, np.bool_)
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
    small = nu == odd.shape[1] and 2 * n * nu * nu <= SMALL
    if small:
        pairs = both.reshape(2 * n + 6, nu)
        square, cross = np.dot(pairs.T, pairs), np.dot(odd.T, U)
        for c in range(nu):
            for b in range(c, nu):
                T[c, b] += square[c, b]
            for b in range(n):
                T[c, nu + b] = cross[c, b]
    j = n if small else 0
    while j < n:
        begin = start[0 if j < off else (j - off) // 3]
        for c in range(begin, nu):
            add_pairs(T, c, nu - c, odd, even, j)
            add_rows(T, c, nu + j, n - j, U, j, j, odd[j, c], odd[j + 1, c], odd[j + 2, c], odd[j + 3, c])
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
            add_rows(P, a, a, n - a, T, c, g, -T[c, g], -T[c + 1, g], -T[c + 2, g], -T[c + 3, g])
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
        for i in range(3):
            mean_out[t, i], mean_out[t, 13 + i], mean_out[t, 16 + i] = w[i], r[i], v[i]
        for i in range(4):
            mean_out[t, 3 + i], mean_out[t, 9 + i] = q[i], s[i]
        mean_out[t, 7], mean_out[t, 8] = k[0], k[1]
        for i in range(n):
            sigma_out[t, i] = np.sqrt(P[i, i])
        for i in range(nb):
            for j in range(nb):
                block_out[t, i, j] = P[i, j]
