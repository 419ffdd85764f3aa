"""The filter with numpy alone: the sums of `prediction` and `correction` over all sigma points at once, with the same numbers."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.kernels import to_body
from massprops.estimators.unscented.algebra import LOST, upper_factor
from massprops.estimators.unscented.components import (
    feature_motion,
    image,
    product,
    torque_free,
    turn_between,
    turned,
    unit,
)
from massprops.estimators.unscented.prediction import BEYOND, WIDEST_TURN, bounded


def factor(A: np.ndarray) -> np.ndarray:
    """U with A = U^T U; rounding below zero is held at a tiny pivot."""
    try:
        upper: np.ndarray = np.linalg.cholesky(A).T
        if np.all(np.diag(upper) ** 2 > LOST * np.diag(A)):
            return upper
    except np.linalg.LinAlgError:
        pass
    upper = A.copy()
    upper_factor(upper, len(A))
    return np.triu(upper)


def _turn(q: np.ndarray, errors: np.ndarray, additive: bool) -> tuple[np.ndarray, ...]:
    """Attitudes of sigma points: q with errors (na, ...)."""
    if additive:
        return unit(q[0] + errors[0], q[1] + errors[1], q[2] + errors[2], q[3] + errors[3])
    return turned(q[0], q[1], q[2], q[3], errors[0], errors[1], errors[2])


def _pairs(deviation: np.ndarray, gamma: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half differences, half sums (rows: pairs) and mean, of deviations (2 rows, + first, by pairs, by components)."""
    odd = (deviation[0] - deviation[1]) / (2.0 * gamma)
    even = (deviation[0] + deviation[1]) / (2.0 * gamma)
    return odd, even, even.sum(axis=0) / gamma


def propagate(w, q, k, s, r, v, P, dt, F, spin, Q, largest_turn, gamma, excess, additive, axes, moving):  # type: ignore[no-untyped-def]
    """As `prediction.propagate`."""
    n, na = len(P), 4 if additive else 3
    nd, nf = 5 + na, 3 + na
    speed = np.linalg.norm(w) + gamma * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2])
    most = 50 if P[3, 3] > 0.25 * WIDEST_TURN**2 else 10000
    steps = int(min(max(1.0, np.ceil(speed * abs(dt) / largest_turn)), most))
    U = factor(P)
    signs = np.array([1.0, -1.0])[:, None] * gamma
    d = U[:nd, :nd].T[:, None, :] * signs  # (component, side, pair)
    d = np.concatenate([np.zeros((nd, 1)), d.reshape(nd, -1)], axis=1)
    out = torque_free(
        w[0] + d[0],
        w[1] + d[1],
        w[2] + d[2],
        *_turn(q, d[3:nf], additive),
        k[0] + d[nf],
        k[1] + d[nf + 1],
        dt,
        steps,
    )
    centre = [float(x[0]) for x in out]
    rates = [x[1:] - x[0] for x in out[:3]]
    if additive:
        attitude = [x[1:] - x[0] for x in out[3:]]
    else:
        attitude = list(turn_between(*centre[3:], *(x[1:] for x in out[3:])))
    odd, even, mean = _pairs(np.array(rates + attitude).reshape(nf, 2, nd).transpose(1, 2, 0), gamma)
    if not sum(x * x for x in centre) + np.sum(odd**2) + np.sum(even**2) < BEYOND:
        P[np.diag_indices(n)] += Q * dt
        w *= 0.5
        bounded(w, P, na)
        return
    P[:nf, :nf] = odd.T @ odd + even.T @ even + excess * np.outer(mean, mean)
    P[:nf, nf:] = odd.T @ U[:nd, nf:]
    P[nf:, :nf] = P[:nf, nf:].T
    w[:] = np.array(centre[:3]) + mean[:3]
    q[:] = _turn(np.array(centre[3:]), mean[3:], additive)
    if np.any(spin[1:] != 0.0):
        q[:] = product(*spin, *q)
    if moving:
        t = nd + (3 if axes else 0)
        moved = F @ np.concatenate([r, v])
        r[:], v[:] = moved[:3], moved[3:]
        P[t : t + 6] = F @ P[t : t + 6]
        P[:, t : t + 6] = P[:, t : t + 6] @ F.T
    P[np.diag_indices(n)] += Q * dt
    bounded(w, P, na)


def sight(w, q, s, r, v, p, K, RC, TC, disparity, flow, extras, mid, still):  # type: ignore[no-untyped-def]
    """Predicted measurements (ny, ...) of sigma points: w, q, s, r, v lists of components (...), p (m, 3, ...)."""
    rows = []
    if extras[0]:
        rows += list(turn_between(*mid, *product(*q, *s)))
    if extras[1]:
        rows += list(to_body(*s, *w))
    if extras[2]:
        rows.append(np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2))
    for i in range(len(p)):
        x, y, z, dx, dy, dz = feature_motion(*q, *w, p[i, 0], p[i, 1], p[i, 2])
        if not still:
            dx, dy, dz = dx + v[0], dy + v[1], dz + v[2]
        eyes = [image(*K[c], RC[c], *TC[c], x + r[0], y + r[1], z + r[2], dx, dy, dz) for c in range(len(K))]
        for eye in eyes:
            rows += [eye[0], eye[1]]
        if disparity:
            rows.append(eyes[1][0] - eyes[0][0])
        if flow:
            for eye in eyes:
                rows += [eye[2], eye[3]]
    return np.array(np.broadcast_arrays(*rows))


def correct(  # type: ignore[no-untyped-def]
    w, q, k, s, r, v, p, P, z, var, att, pinned, reference, K, RC, TC, group,
    disparity, flow, extras, gamma, excess, gate, additive, axes, moving, tally,
):  # fmt: skip
    """As `correction.correct`."""
    n, m, na = len(P), len(p), 4 if additive else 3
    nd = 5 + na
    tr = nd + (3 if axes else 0)
    off = tr + (6 if moving else 0)
    index = np.flatnonzero(np.isfinite(z) & (var > 0.0))
    if not len(index):
        return
    U = factor(P)
    d = np.concatenate(
        [np.zeros((n, 1)), (U.T[:, None, :] * (np.array([1.0, -1.0])[:, None] * gamma)).reshape(n, -1)], 1
    )
    place, pace = (reference, v) if pinned else (r, v)
    q1 = _turn(q, d[3 : 3 + na], additive)
    s1 = turned(*s, *d[nd : nd + 3]) if axes else tuple(s)
    w1 = [w[i] + d[i] for i in range(3)]
    free = moving and not pinned
    r1 = [place[i] + (d[tr + i] if free else 0.0) for i in range(3)]
    v1 = [pace[i] + (d[tr + 3 + i] if free else 0.0) for i in range(3)]
    p1 = p[:, :, None] + d[off:].reshape(m, 3, d.shape[1])
    mid = product(*q, *s)
    h = sight(w1, q1, s1, r1, v1, p1, K, RC, TC, disparity, flow, extras, mid, pinned)
    h0 = h[:, 0]
    odd, even, mean = _pairs((h[:, 1:] - h0[:, None])[index].reshape(len(index), 2, n).transpose(1, 2, 0), gamma)
    value = z.copy()
    if extras[0]:
        value[:3] = turn_between(*mid, *att)
    innovation = value[index] - h0[index] - mean
    noise, inflate = var[index], 1.0
    if gate > 0.0:
        spread = np.sum(odd**2 + even**2, axis=0) + excess * mean**2
        ratio = innovation**2 / (spread + noise)
        bad = ratio > gate**2
        if 2 * bad.sum() > len(index):
            inflate = max(1.0, float(np.median(ratio)))
        elif bad.any():
            keep = ~np.isin(group[index], group[index[bad]])
            tally[2] += int((~keep).sum())
            index, innovation, noise, mean = index[keep], innovation[keep], noise[keep], mean[keep]
            odd, even = odd[:, keep], even[:, keep]
            if not len(index):
                return
    S = odd.T @ odd + even.T @ even + excess * np.outer(mean, mean) + np.diag(inflate * noise)
    cross_covariance = odd.T @ U
    from scipy.linalg import solve_triangular

    W = solve_triangular(factor(S), np.column_stack([cross_covariance, innovation]), trans="T", check_finite=False)
    step = W[:, n] @ W[:, :n]
    if not np.isfinite(np.sum(W[:, n] ** 2) + np.sum(step**2)):
        return
    P -= W[:, :n].T @ W[:, :n]
    P[:] = 0.5 * (P + P.T)
    P[np.diag_indices(n)] = np.maximum(np.diag(P), 1e-290)
    tally[0] += float(W[:, n] @ W[:, n])
    tally[1] += len(index)
    w += step[:3]
    q[:] = _turn(q, step[3 : 3 + na], additive)
    k[:] = np.clip(k + step[3 + na : nd], -5.0, 5.0)
    if axes:
        s[:] = turned(*s, *step[nd : nd + 3])
    if moving:
        r += step[tr : tr + 3]
        v += step[tr + 3 : tr + 6]
    p += step[off:].reshape(m, 3)
    bounded(w, P, na)


def run_loop(  # type: ignore[no-untyped-def]
    w, q, k, s, r, v, p, P, dt, F, spin, z, var, att, pinned, reference, K, RC, TC, group, Q,
    disparity, flow, extras, gamma, excess, gate, largest_turn, additive, axes, moving,
    mean_out, sigma_out, block_out, tally_out,
):  # fmt: skip
    """As `correction.run_loop`."""
    nb = block_out.shape[1]
    # a lost filter meets infinities; they are caught where they would enter the state
    old = np.seterr(all="ignore")
    for t in range(len(dt)):
        if dt[t] > 0.0:
            propagate(
                w, q, k, s, r, v, P, dt[t], F[t], spin[t], Q, largest_turn, gamma, excess, additive, axes, moving
            )  # fmt: skip
        correct(
            w, q, k, s, r, v, p, P, z[t], var[t], att[t], pinned[t], reference, K, RC, TC, group,
            disparity, flow, extras, gamma, excess, gate, additive, axes, moving, tally_out[t],
        )  # fmt: skip
        mean_out[t] = np.concatenate([w, q, k, s, r, v])
        sigma_out[t] = np.sqrt(np.diag(P))
        block_out[t] = P[:nb, :nb]
    np.seterr(**old)
