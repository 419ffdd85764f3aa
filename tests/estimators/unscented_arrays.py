"""The unscented filter with numpy alone: the sums of `prediction` and `correction` over all sigma points at once."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from massprops.dynamics.kernels import product, to_body, turn_between, turned, unit
from massprops.estimators.filters.algebra import LOST, upper_factor
from massprops.estimators.filters.components import feature_motion, image, inertia_of, torque_free
from massprops.estimators.filters.prediction import BEYOND, WIDEST_TURN, bounded
from massprops.estimators.filters.rule import (
    AXES,
    POINTS,
    POSITION,
    RATIO,
    VELOCITY,
    Record,
    Rule,
    Seen,
    Steps,
    leading,
    place_error,
    point_error,
)


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


def around(U: np.ndarray, gamma: float) -> np.ndarray:
    """Errors of the sigma points (rows of U, 1 + 2 columns of it): none, then each row of U both ways, one way first."""
    signs = np.array([1.0, -1.0])[:, None] * gamma
    return np.concatenate([np.zeros((U.shape[1], 1)), (U.T[:, None, :] * signs).reshape(U.shape[1], -1)], axis=1)


def propagate(x: np.ndarray, P: np.ndarray, dt: float, F: np.ndarray, spin: np.ndarray, noise, rule: Rule) -> None:  # type: ignore[no-untyped-def]
    """As `prediction.propagate`."""
    n, nd, additive = len(P), leading(rule), rule.additive
    nf = nd - 2
    w, q, k = x[:3], x[3:7], x[RATIO:AXES]
    speed = np.linalg.norm(w) + rule.gamma * np.sqrt(P[0, 0] + P[1, 1] + P[2, 2])
    most = 50 if P[3, 3] > 0.25 * WIDEST_TURN**2 else 10000
    steps = int(min(max(1.0, np.ceil(speed * abs(dt) / rule.largest_turn)), most))
    U = factor(P)
    d = around(U[:nd, :nd], rule.gamma)
    rates = (w[0] + d[0], w[1] + d[1], w[2] + d[2])
    inertia = inertia_of(k[0] + d[nf], k[1] + d[nf + 1])
    out = torque_free(rates, _turn(q, d[3:nf], additive), inertia, dt, steps)
    centre = [float(c[0]) for c in out]
    turns = [c[1:] - c[0] for c in out[:3]]
    if additive:
        turns += [c[1:] - c[0] for c in out[3:]]
    else:
        turns += list(turn_between(*centre[3:], *(c[1:] for c in out[3:])))
    odd, even, mean = _pairs(np.array(turns).reshape(nf, 2, nd).transpose(1, 2, 0), rule.gamma)
    if not sum(c * c for c in centre) + np.sum(odd**2) + np.sum(even**2) < BEYOND:
        P[np.diag_indices(n)] += noise * dt
        w *= 0.5
        bounded(x, P, rule)
        return
    P[:nf, :nf] = odd.T @ odd + even.T @ even + rule.excess * np.outer(mean, mean)
    P[:nf, nf:] = odd.T @ U[:nd, nf:]
    P[nf:, :nf] = P[:nf, nf:].T
    w[:] = np.array(centre[:3]) + mean[:3]
    q[:] = _turn(np.array(centre[3:]), mean[3:], additive)
    if np.any(spin[1:] != 0.0):
        q[:] = product(*spin, *q)
    if rule.moving:
        t = place_error(rule)
        x[POSITION:POINTS] = F @ x[POSITION:POINTS]
        P[t : t + 6] = F @ P[t : t + 6]
        P[:, t : t + 6] = P[:, t : t + 6] @ F.T
    P[np.diag_indices(n)] += noise * dt
    bounded(x, P, rule)


def sight(x, eyes: np.ndarray, mid: tuple, still: bool, rule: Rule) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Predicted measurements (ny, ...) of sigma points: x, a list of the state's components (...)."""
    w, q, s, r, v, p = x[:3], x[3:7], x[AXES:POSITION], x[POSITION:VELOCITY], x[VELOCITY:POINTS], x[POINTS:]
    rows = []
    if rule.attitude:
        rows += list(turn_between(*mid, *product(*q, *s)))
    if rule.rates:
        rows += list(to_body(*s, *w))
    if rule.range:
        rows.append(np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2))
    for i in range(0, len(p), 3):
        a, b, c, da, db, dc = feature_motion(*q, *w, p[i], p[i + 1], p[i + 2])
        if not still:
            da, db, dc = da + v[0], db + v[1], dc + v[2]
        seen = [image(eyes, k, a + r[0], b + r[1], c + r[2], da, db, dc) for k in range(len(eyes))]
        for eye in seen:
            rows += [eye[0], eye[1]]
        if rule.disparity:
            rows.append(seen[1][0] - seen[0][0])
        if rule.flow:
            for eye in seen:
                rows += [eye[2], eye[3]]
    return np.array(np.broadcast_arrays(*rows))


def displaced(x: np.ndarray, d: np.ndarray, place: np.ndarray, rule: Rule) -> list:
    """The state's components at errors d (N, ...), the centre of mass at `place` where that is a place."""
    nd, t, off = leading(rule), place_error(rule), point_error(rule)
    still = not np.isnan(place[0])
    out = [x[i] + d[i] for i in range(3)] + list(_turn(x[3:7], d[3 : nd - 2], rule.additive)) + [x[RATIO], x[RATIO + 1]]
    s = x[AXES:POSITION]
    out += list(turned(*s, *d[nd : nd + 3])) if rule.axes_free else list(s)
    where = [*place, *x[VELOCITY:POINTS]] if still else list(x[POSITION:POINTS])
    out += [where[i] + d[t + i] for i in range(6)] if rule.moving and not still else where
    return out + [x[POINTS + i] + d[off + i] for i in range(len(x) - POINTS)]


def correct(x, P, z, variance, attitude, place, eyes, group, rule, tally) -> None:  # type: ignore[no-untyped-def]
    """As `correction.correct`."""
    n, nd = len(P), leading(rule)
    index = np.flatnonzero(np.isfinite(z) & (variance > 0.0))
    if not len(index):
        return
    U = factor(P)
    mid = product(*x[3:7], *x[AXES:POSITION])
    h = sight(displaced(x, around(U, rule.gamma), place, rule), eyes, mid, not np.isnan(place[0]), rule)
    h0 = h[:, 0]
    odd, even, mean = _pairs((h[:, 1:] - h0[:, None])[index].reshape(len(index), 2, n).transpose(1, 2, 0), rule.gamma)
    value = z.copy()
    if rule.attitude:
        value[:3] = turn_between(*mid, *attitude)
    innovation = value[index] - h0[index] - mean
    noise, inflate = variance[index], 1.0
    if rule.gate > 0.0:
        spread = np.sum(odd**2 + even**2, axis=0) + rule.excess * mean**2
        ratio = innovation**2 / (spread + noise)
        bad = ratio > rule.gate**2
        if 2 * bad.sum() > len(index):
            inflate = max(1.0, float(np.median(ratio)))
        elif bad.any():
            keep = ~np.isin(group[index], group[index[bad]])
            tally[2] += int((~keep).sum())
            index, innovation, noise, mean = index[keep], innovation[keep], noise[keep], mean[keep]
            odd, even = odd[:, keep], even[:, keep]
            if not len(index):
                return
    S = odd.T @ odd + even.T @ even + rule.excess * np.outer(mean, mean) + np.diag(inflate * noise)
    W = solve_triangular(factor(S), np.column_stack([odd.T @ U, innovation]), trans="T", check_finite=False)
    step = W[:, n] @ W[:, :n]
    if not np.isfinite(np.sum(W[:, n] ** 2) + np.sum(step**2)):
        return
    P -= W[:, :n].T @ W[:, :n]
    P[:] = 0.5 * (P + P.T)
    P[np.diag_indices(n)] = np.maximum(np.diag(P), 1e-290)
    tally[0] += float(W[:, n] @ W[:, n])
    tally[1] += len(index)
    x[3:7] = _turn(x[3:7], step[3 : nd - 2], rule.additive)
    x[:3] += step[:3]
    x[RATIO:AXES] = np.clip(x[RATIO:AXES] + step[nd - 2 : nd], -5.0, 5.0)
    if rule.axes_free:
        x[AXES:POSITION] = turned(*x[AXES:POSITION], *step[nd : nd + 3])
    if rule.moving:
        x[POSITION:POINTS] += step[place_error(rule) : place_error(rule) + 6]
    x[POINTS:] += step[point_error(rule) :]
    bounded(x, P, rule)


def run_loop(x: np.ndarray, P: np.ndarray, steps: Steps, seen: Seen, rule: Rule, record: Record) -> None:
    """As `correction.run_loop`."""
    # a lost filter meets infinities; they are caught where they would enter the state
    with np.errstate(all="ignore"):
        for t in range(len(steps.dt)):
            if steps.dt[t] > 0.0:
                propagate(x, P, steps.dt[t], steps.F[t], steps.spin[t], steps.noise, rule)
            rows = (seen.z[t], seen.variance[t], seen.attitude[t], seen.place[t])
            correct(x, P, *rows, seen.eyes, seen.group, rule, record.tally[t])
            record.mean[t] = x[:POINTS]
            record.sigma[t] = np.sqrt(np.diag(P))
            record.block[t] = P[: record.block.shape[1], : record.block.shape[1]]
