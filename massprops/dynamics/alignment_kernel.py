"""`alignment.align` compiled: one epoch after the other; import it late.

Plain loops: what numpy does in one call (`outer`, an array put into a slice) takes numba seconds to compile.
"""

from __future__ import annotations

import numba
import numpy as np

from massprops.dynamics.compiled import matrix_of, turned, unit

Array = np.ndarray

SINGULAR = 1e-10
"""Pivot of a normal matrix with unit diagonal under which it counts as singular."""


@numba.njit(cache=True)
def aligned(
    body: Array,
    seen: Array,
    information: Array,
    use: Array,
    q: Array,
    shift: Array,
    soft: int,
    hard: int,
    limit: float,
    third: int,
) -> tuple[Array, Array]:
    """Poses q (n, 4) and shift (n, 3), changed in place, after `soft` and `hard` rounds.

    Args:
        limit: squared distance of an outlier; third: number of the distance, from the least, that may stretch it.

    Returns:
        covariance (n, 6, 6), squared distances (n, m), infinite where not used.
    """
    n, m = use.shape
    covariance, out = np.empty((n, 6, 6)), np.full((n, m), np.inf)
    near, arms, errors = np.empty(m), np.empty((m, 3)), np.empty((m, 3))
    R, step = np.empty((3, 3)), np.empty(6)
    normal, inverse, L = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    gradient, scale, side, regular = np.empty(6), np.empty(6), np.empty(6), True
    for e in range(n):
        for turn in range(soft + hard):
            count = _distances(body, seen[e], information[e], use[e], q[e], shift[e], R, arms, errors, near)
            size = _outlier_size(near[:count], turn < soft, limit, third)
            normal[:], gradient[:] = 0.0, 0.0
            at = 0
            for p in range(m):
                if not use[e, p]:
                    continue
                share = 1.0 / (1.0 + near[at] / size) if turn < soft else (1.0 if near[at] <= size else 0.0)
                _add(normal, gradient, arms[at], errors[at], information[e, p], share)
                at += 1
            regular = _factored(normal, scale, L)
            if regular:
                _solved(L, scale, gradient, step)
            else:
                _pseudo(normal, scale, inverse)
                np.dot(inverse, gradient, step)
            _moved(q[e], shift[e], step)
        for i in range(6):
            side[:] = 0.0
            side[i] = 1.0
            if regular:
                _solved(L, scale, side, covariance[e, i])
            else:
                np.dot(inverse, side, covariance[e, i])
        # squares of the pose returned, not of the one before its last step
        _distances(body, seen[e], information[e], use[e], q[e], shift[e], R, arms, errors, near)
        at = 0
        for p in range(m):
            if use[e, p]:
                out[e, p] = near[at]
                at += 1
    return covariance, out


@numba.njit(cache=True)
def _moved(q: Array, shift: Array, step: Array) -> None:
    """A pose after a step (6,) of turn and shift, in place; a long turn is cut to 0.3 rad."""
    length = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    damp = min(1.0, 0.3 / max(length, 1e-12))
    _turned(q, damp * step[0], damp * step[1], damp * step[2])
    for i in range(3):
        shift[i] += damp * step[3 + i]


@numba.njit(cache=True)
def _outlier_size(squares: Array, soft: bool, limit: float, third: int) -> float:
    """The squared distance from which a point counts less: `limit`, or more where many points lie farther."""
    if len(squares) > 0:
        ordered = np.sort(squares)
        if soft:
            return float(max(limit, ordered[(len(squares) - 1) // 2]))
        if third < len(squares):
            return float(max(limit, 2.0 * ordered[third]))
    return limit


@numba.njit(cache=True)
def _distances(
    body: Array,
    seen: Array,
    information: Array,
    use: Array,
    q: Array,
    shift: Array,
    R: Array,
    arms: Array,
    errors: Array,
    near: Array,
) -> int:
    """Turned points, errors and squared distances of those in use, side by side; how many."""
    matrix_of(q[0], q[1], q[2], q[3], R)
    count = 0
    for p in range(len(use)):
        if not use[p]:
            continue
        total = 0.0
        for i in range(3):
            arms[count, i] = R[i, 0] * body[p, 0] + R[i, 1] * body[p, 1] + R[i, 2] * body[p, 2]
            errors[count, i] = seen[p, i] - shift[i] - arms[count, i]
        for i in range(3):
            for j in range(3):
                total += errors[count, i] * information[p, i, j] * errors[count, j]
        near[count] = total
        count += 1
    return count


@numba.njit(cache=True)
def _add(normal: Array, gradient: Array, arm: Array, error: Array, information: Array, share: float) -> None:
    """One point's part of the normal equations: turn about the reference axes, then shift; lower triangle."""
    x, y, z = arm
    a, b, c = share * information[0, 0], share * information[0, 1], share * information[0, 2]
    d, e, f = share * information[1, 1], share * information[1, 2], share * information[2, 2]
    # weight times [arm x]
    w00, w01, w02 = b * z - c * y, c * x - a * z, a * y - b * x
    w10, w11, w12 = d * z - e * y, e * x - b * z, b * y - d * x
    w20, w21, w22 = e * z - f * y, f * x - c * z, c * y - e * x
    normal[0, 0] += z * w10 - y * w20
    normal[1, 0] += x * w20 - z * w00
    normal[1, 1] += x * w21 - z * w01
    normal[2, 0] += y * w00 - x * w10
    normal[2, 1] += y * w01 - x * w11
    normal[2, 2] += y * w02 - x * w12
    normal[3, 0] -= w00
    normal[3, 1] -= w01
    normal[3, 2] -= w02
    normal[4, 0] -= w10
    normal[4, 1] -= w11
    normal[4, 2] -= w12
    normal[5, 0] -= w20
    normal[5, 1] -= w21
    normal[5, 2] -= w22
    normal[3, 3] += a
    normal[4, 3] += b
    normal[4, 4] += d
    normal[5, 3] += c
    normal[5, 4] += e
    normal[5, 5] += f
    u = a * error[0] + b * error[1] + c * error[2]
    v = b * error[0] + d * error[1] + e * error[2]
    w = c * error[0] + e * error[1] + f * error[2]
    gradient[0] += y * w - z * v
    gradient[1] += z * u - x * w
    gradient[2] += x * v - y * u
    gradient[3] += u
    gradient[4] += v
    gradient[5] += w


@numba.njit(cache=True)
def _factored(normal: Array, scale: Array, L: Array) -> bool:
    """Writes the Cholesky factor of `normal` scaled to a unit diagonal; False where that is singular."""
    for i in range(6):
        scale[i] = 1.0 / np.sqrt(max(normal[i, i], 1e-300))
    for j in range(6):
        for i in range(j, 6):
            total = normal[i, j] * scale[i] * scale[j]
            for a in range(j):
                total -= L[i, a] * L[j, a]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total > SINGULAR:
                L[i, i] = np.sqrt(total)
            else:
                return False
    return True


@numba.njit(cache=True)
def _solved(L: Array, scale: Array, side: Array, x: Array) -> None:
    for i in range(6):
        total = side[i] * scale[i]
        for a in range(i):
            total -= L[i, a] * x[a]
        x[i] = total / L[i, i]
    for i in range(5, -1, -1):
        total = x[i]
        for a in range(i + 1, 6):
            total -= L[a, i] * x[a]
        x[i] = total / L[i, i]
    for i in range(6):
        x[i] *= scale[i]


@numba.njit(cache=True)
def _pseudo(normal: Array, scale: Array, out: Array) -> None:
    """Inverse in which a direction without information gets none."""
    scaled = np.empty((6, 6))
    for i in range(6):
        for j in range(i + 1):
            scaled[i, j] = scaled[j, i] = normal[i, j] * scale[i] * scale[j]
    values, vectors = np.linalg.eigh(scaled)
    least = 1e-12 * max(-values[0], values[5])
    for i in range(6):
        for j in range(6):
            total = 0.0
            for a in range(6):
                if abs(values[a]) > least:
                    total += vectors[i, a] * vectors[j, a] / values[a]
            out[i, j] = total * (scale[i] * scale[j])


@numba.njit(cache=True)
def _turned(q: Array, x: float, y: float, z: float) -> None:
    """A small turn about the reference axes, in place: seen from the body it is the inverse turned the other way."""
    w, a, b, d = turned(q[0], -q[1], -q[2], -q[3], -x, -y, -z)
    w, a, b, d = unit(w, a, b, d)
    q[0], q[1], q[2], q[3] = w, -a, -b, -d
