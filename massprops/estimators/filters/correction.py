"""The filter as plain loops, to be compiled by numba.

The sigma points are those of the whole state, but what is zero is not computed. With P = U^T U, rotation first in
the state: only the rows of U that touch rates, attitude and ratios need the equations of motion; the row of a feature
touches only that feature and those after it; and what moves linearly keeps its covariance exactly. Sums over pairs of
sigma points are taken as half differences and half sums, in which no weight is negative, so P never turns indefinite.
"""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import turn_between, turned, unit
from massprops.estimators.filters.algebra import (
    add_pairs,
    add_rows,
    add_to_mean,
    difference,
    middle,
    take_rows,
    upper_factor,
)
from massprops.estimators.filters.prediction import bounded, perturbed, propagate
from massprops.estimators.filters.rule import (
    ATTITUDE,
    AXES,
    INERTIA,
    POINTS,
    POSITION,
    RATIO,
    Record,
    Rule,
    Seen,
    Steps,
    Turn,
    ahead,
    leading,
    per_feature,
    place_error,
    point_error,
)
from massprops.estimators.filters.sight import axes_in_reference, sight

SMALL = 200_000
"""Products up to which BLAS is used: it is quicker than the loops, and keeps to one thread."""


def chosen(z: np.ndarray, variance: np.ndarray, first: int, per: int, index: np.ndarray, used: np.ndarray) -> int:
    """Writes the numbers of what is measured into index (ny,), and which features are into used (m,). Returns how many there are.

    z, variance: (ny,); first: row of the first feature; per: rows of one.
    """
    count = 0
    for c in range(z.shape[0]):
        if np.isfinite(z[c]) and variance[c] > 0.0:
            index[count] = c
            count += 1
            if c >= first:
                used[(c - first) // per] = True
    return count


def begin_rows(index: np.ndarray, count: int, first: int, per: int, start: np.ndarray) -> None:
    """Writes into start (m + 1,), for each feature, the first row of index (nu,) that is its own or a later one's."""
    row = 0
    for i in range(start.shape[0]):
        while row < count and index[row] < first + per * i:
            row += 1
        start[i] = row
    start[0] = 0  # what is not a feature's is touched by the rows before the features


def displaced(x1: np.ndarray, x: np.ndarray, g: float, U: np.ndarray, j: int, rule: Rule, still: bool) -> None:
    """The sigma point g along row j of U (N + 3, N) from the state x, into x1, both (POINTS + 3 m,), but for the features."""
    nd, t = leading(rule), place_error(rule)
    if j < nd:
        for i in range(3):
            x1[i] = x[i] + g * U[j, i]
        q = perturbed(x, g, U, j, rule.additive)
        for i in range(4):
            x1[ATTITUDE + i] = q[i]
    if rule.axes_free and j < nd + 3:
        s = turned(x[AXES], x[AXES + 1], x[AXES + 2], x[AXES + 3], g * U[j, nd], g * U[j, nd + 1], g * U[j, nd + 2])
        for i in range(4):
            x1[AXES + i] = s[i]
    if rule.moving and j < t + 6 and not still:
        for i in range(6):
            x1[POSITION + i] = x[POSITION + i] + g * U[j, t + i]


def sigma_rows(
    both: np.ndarray,
    U: np.ndarray,
    x: np.ndarray,
    mid: Turn,
    still: bool,
    eyes: np.ndarray,
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
    rule: Rule,
    h0: np.ndarray,
) -> None:
    """Half differences and half sums of the sigma points' measurements, into both (2, N + 3, nu).

    U: (N + 3, N); x: (POINTS + 3 m,). mid: attitude that turns are measured from. still: features stand as if the centre of mass did
    not move. eyes: (c, 16) cameras. rows: index (nu,), start (m + 1,) and used (m,), of what is measured. h0: (ny,) zeros, takes the
    mean's own measurements.
    """
    odd, even = both[0], both[1]
    index, start, used = rows
    n, m, nu, ny = U.shape[1], used.shape[0], odd.shape[1], h0.shape[0]
    off, half = point_error(rule), 0.5 / rule.gamma
    sight(h0, used, 0, x, eyes, mid, still, rule)
    hp, hm, x1 = np.zeros(ny), np.zeros(ny), x.copy()
    for j in range(n):
        f0 = 0 if j < off else (j - off) // 3
        for side in range(2):
            g = rule.gamma if side == 0 else -rule.gamma
            h = hp if side == 0 else hm
            displaced(x1, x, g, U, j, rule, still)
            for i in range(3 * f0, 3 * m):
                x1[POINTS + i] = x[POINTS + i] + g * U[j, off + i]
            sight(h, used, f0, x1, eyes, mid, still, rule)
        for i in range(POINTS):
            x1[i] = x[i]
        if nu == ny:
            difference(odd, even, j, start[f0], nu, hp, hm, h0, half)
        else:
            for c in range(start[f0], nu):
                i = index[c]
                odd[j, c] = half * (hp[i] - hm[i])
                even[j, c] = half * (hp[i] + hm[i] - 2.0 * h0[i])
        if j >= off:
            for i in range(3 * f0, 3 * f0 + 3):
                x1[POINTS + i] = x[POINTS + i]


def gated(
    both: np.ndarray,
    index: np.ndarray,
    value: np.ndarray,
    noise: np.ndarray,
    mean: np.ndarray,
    spread: np.ndarray,
    group: np.ndarray,
    gate: float,
) -> tuple[int, float]:
    """How many rows are kept, moved to the front, and by what their noise is widened.

    both: (2, N + 3, nu); index, value, noise, mean, spread: (nu,) as of `innovations`; group: (ny,); gate [sigma].
    """
    odd, even = both[0], both[1]
    nu = value.shape[0]
    ratio = np.empty(nu)
    bad = 0
    for c in range(nu):
        ratio[c] = value[c] * value[c] / (spread[c] + noise[c])
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
            index[keep], value[keep], noise[keep], mean[keep] = index[c], value[c], noise[c], mean[c]
            for j in range(odd.shape[0]):
                odd[j, keep], even[j, keep] = odd[j, c], even[j, c]
            keep += 1
    return keep, 1.0


def add_sums(T: np.ndarray, both: np.ndarray, U: np.ndarray, start: np.ndarray, off: int, small: bool) -> None:
    """Adds the sums over the sigma points to T = [S, cross-covariance, innovation], (nu, nu + N + 1), row by row above the diagonal.

    both: (2, N + 3, nu or more); U: (N + 3, N); start: (m + 1,); off: first error of the first feature.
    """
    odd, even = both[0], both[1]
    n, nu = U.shape[1], T.shape[0]
    if small:
        pairs = both.reshape(2 * n + 6, nu)
        square, cross = np.dot(pairs.T, pairs), np.dot(odd.T, U)
        for c in range(nu):
            for b in range(c, nu):
                T[c, b] += square[c, b]
            for b in range(n):
                T[c, nu + b] = cross[c, b]
    # four sigma-point pairs at a time; zero rows make the count even
    j = n if small else 0
    while j < n:
        for c in range(start[0 if j < off else (j - off) // 3], nu):
            add_pairs(T, c, nu - c, odd, even, j)
            add_rows(T, c, nu + j, n - j, U, j, j, (odd[j, c], odd[j + 1, c], odd[j + 2, c], odd[j + 3, c]))
        j += 4


def take_gain(P: np.ndarray, T: np.ndarray, small: bool) -> None:
    """Takes the square of the whitened cross-covariance, columns nu to nu + N of T (nu, nu + N + 1), from P (N, N)."""
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
            f = T[c, g]
            for b in range(a, n):
                P[a, b] -= f * T[c, nu + b]
            c += 1
    for a in range(n):
        P[a, a] = max(P[a, a], 1e-290)
        for b in range(a):
            P[a, b] = P[b, a]


def move_mean(x: np.ndarray, step: np.ndarray, rule: Rule) -> None:
    """The state x (POINTS + 3 m,) by a step (N,) of its error, in place."""
    nd, t, off = leading(rule), place_error(rule), point_error(rule)
    for i in range(3):
        x[i] += step[i]
    if rule.additive:
        u = unit(x[3] + step[3], x[4] + step[4], x[5] + step[5], x[6] + step[6])
    else:
        u = turned(x[3], x[4], x[5], x[6], step[3], step[4], step[5])
    for i in range(4):
        x[ATTITUDE + i] = u[i]
    for i in range(INERTIA):
        x[RATIO + i] = min(max(x[RATIO + i] + step[nd - INERTIA + i], -5.0), 5.0)
    if rule.axes_free:
        u = turned(x[AXES], x[AXES + 1], x[AXES + 2], x[AXES + 3], step[nd], step[nd + 1], step[nd + 2])
        for i in range(4):
            x[AXES + i] = u[i]
    if rule.moving:
        for i in range(6):
            x[POSITION + i] += step[t + i]
    for i in range(off, step.shape[0]):
        x[POINTS + i - off] += step[i]


def innovations(
    both: np.ndarray,
    z: np.ndarray,
    variance: np.ndarray,
    h0: np.ndarray,
    mid: Turn,
    attitude: np.ndarray,
    index: np.ndarray,
    rule: Rule,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean, innovation, variance by the sigma points, and noise of each row, (nu,) each.

    both: (2, N + 3, nu); z, variance, h0: (ny,); mid, attitude: (4,) the state's and the measured one; index: (nu,).
    """
    odd, even = both[0], both[1]
    nu = index.shape[0]
    mean, value, spread, noise = np.zeros(nu), np.zeros(nu), np.zeros(nu), np.empty(nu)
    for j in range(odd.shape[0] - 3):
        add_to_mean(mean, spread, odd, even, j, rule.gate > 0.0)
    for c in range(nu):
        mean[c] *= 1.0 / rule.gamma
    if rule.attitude:
        seen = turn_between(mid[0], mid[1], mid[2], mid[3], attitude[0], attitude[1], attitude[2], attitude[3])
    else:
        seen = (0.0, 0.0, 0.0)
    for c in range(nu):
        i = index[c]
        measured = seen[i] if (rule.attitude and i < 3) else z[i]
        value[c] = measured - h0[i] - mean[c]
        spread[c] += rule.excess * mean[c] * mean[c]
        noise[c] = variance[i]
    return mean, value, spread, noise


def rows_of(
    z: np.ndarray, variance: np.ndarray, features: int, cameras: int, rule: Rule
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of what is measured (nu,), which features are (m,), and for each feature the first row of its own or a later one
    (m + 1,); z, variance: (ny,)."""
    ny, first, per = z.shape[0], ahead(rule), per_feature(cameras, rule)
    index, used, start = np.empty(ny, np.int64), np.zeros(features, np.bool_), np.zeros(features + 1, np.int64)
    nu = chosen(z, variance, first, per, index, used)
    index = index[:nu]
    begin_rows(index, nu, first, per, start)
    return index, used, start


def root_of(P: np.ndarray) -> np.ndarray:
    """U (N + 3, N) with P (N, N) = U^T U, and three rows of zeros below it."""
    n = P.shape[0]
    U = np.zeros((n + 3, n))
    for i in range(n):
        for c in range(n):
            U[i, c] = P[i, c]
    upper_factor(U, n)
    return U


def joint_root(
    both: np.ndarray,
    U: np.ndarray,
    start: np.ndarray,
    mean: np.ndarray,
    value: np.ndarray,
    noise: np.ndarray,
    nu: int,
    inflate: float,
    rule: Rule,
) -> tuple[np.ndarray, bool]:
    """The factor of the first nu rows' covariance S, with the whitened cross-covariance and innovation: (nu, nu + N + 1); and whether
    BLAS made the sums.

    both: (2, N + 3, nu or more); U: (N + 3, N); start: (m + 1,); mean, value, noise: (nu or more,); inflate: of the noise.
    """
    n = U.shape[1]
    small = nu == both.shape[2] and 2 * n * nu * nu <= SMALL
    T = np.zeros((nu, nu + n + 1))
    for c in range(nu):
        f = rule.excess * mean[c]
        for b in range(c, nu):
            T[c, b] = f * mean[b]
        T[c, c] += inflate * noise[c]
        T[c, nu + n] = value[c]
    add_sums(T, both, U, start, point_error(rule), small)
    upper_factor(T, nu)
    return T, small


def correct(
    x: np.ndarray,
    P: np.ndarray,
    z: np.ndarray,
    variance: np.ndarray,
    attitude: np.ndarray,
    place: np.ndarray,
    eyes: np.ndarray,
    group: np.ndarray,
    rule: Rule,
    tally: np.ndarray,
) -> None:
    """One epoch's measurements, in place.

    x: (POINTS + 3 m,); P: (N, N); z, variance, group: (ny,); attitude: (4,) measured; place: (3,) [m] as of `rule.Seen`; eyes: (c, 16);
    tally: (3,) normalised innovation squared, used, gated.
    """
    n, m, ny = P.shape[0], (x.shape[0] - POINTS) // 3, z.shape[0]
    index, used, start = rows_of(z, variance, m, eyes.shape[0], rule)
    nu = index.shape[0]
    if nu == 0:
        return
    U = root_of(P)
    still = not np.isnan(place[0])
    seen_from = x.copy()
    if still:
        for i in range(3):
            seen_from[POSITION + i] = place[i]
    mid = axes_in_reference(x)
    h0, both = np.zeros(ny), np.zeros((2, n + 3, nu))
    sigma_rows(both, U, seen_from, mid, still, eyes, (index, start, used), rule, h0)
    mean, value, spread, noise = innovations(both, z, variance, h0, mid, attitude, index, rule)
    kept, inflate = nu, 1.0
    if rule.gate > 0.0:
        kept, inflate = gated(both, index, value, noise, mean, spread, group, rule.gate)
        tally[2] += nu - kept
        if kept == 0:
            return
        if kept < nu:
            begin_rows(index, kept, ahead(rule), per_feature(eyes.shape[0], rule), start)
    T, small = joint_root(both, U, start, mean, value, noise, kept, inflate, rule)
    absorb(x, P, T, small, rule, tally)


def absorb(x: np.ndarray, P: np.ndarray, T: np.ndarray, small: bool, rule: Rule, tally: np.ndarray) -> None:
    """The state x (POINTS + 3 m,) and its covariance P (N, N) with what T says, the factor of S with the whitened cross-covariance and
    innovation (nu, nu + N + 1); tally: (3,) as of `correct`."""
    n, nu = P.shape[0], T.shape[0]
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
    take_gain(P, T, small)
    move_mean(x, step, rule)
    bounded(x, P, rule)


def run_loop(x: np.ndarray, P: np.ndarray, steps: Steps, seen: Seen, rule: Rule, record: Record) -> None:
    """All epochs, `rule.Steps` and `rule.Seen`, into `rule.Record`; x (POINTS + 3 m,) and P (N, N) end at the last one."""
    dt, F, spin, noise, chaser = steps
    z, variance, attitude, place, eyes, group = seen
    mean, sigma, block, tally = record
    n, nb = P.shape[0], block.shape[1]
    for t in range(dt.shape[0]):
        if dt[t] > 0.0:
            propagate(x, P, (dt[t], chaser[t]), F[t], spin[t], noise, rule)
        correct(x, P, z[t], variance[t], attitude[t], place[t], eyes, group, rule, tally[t])
        for i in range(POINTS):
            mean[t, i] = x[i]
        for i in range(n):
            sigma[t, i] = np.sqrt(P[i, i])
        for i in range(nb):
            for j in range(nb):
                block[t, i, j] = P[i, j]
