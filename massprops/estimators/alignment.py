"""The rotation and shift between two sets of the same points."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise, rotation_matrix

SOFT_ROUNDS = 4
HARD_ROUNDS = 3
LARGEST_MAHALANOBIS = 16.27
"""Squared Mahalanobis distance of a point in three dimensions that one in a thousand good points exceeds."""
LARGEST_INVERSE = 1e9
"""Element of an inverse, in units of the diagonal, up to which the plain inverse is as good as any."""
LEAST_SPREAD = 1e-3
"""Second singular value of a point set over its first, below which the points lie on a line."""


def q_method(body: np.ndarray, seen: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Davenport's q-method (Horn): the rotation that best takes body vectors into seen ones.

    Args:
        body, seen: (..., m, 3) vectors; weight: (..., m), zero leaves one out.

    Returns:
        (..., 4) Hamilton quaternion, seen = q body q* (feng2018 eq 15; the paper's eigenvector is its conjugate).
    """
    B = np.einsum("...m,...mi,...mj->...ij", weight, seen, body)
    trace = np.einsum("...ii->...", B)
    K = np.empty((*trace.shape, 4, 4))
    K[..., 0, 0] = trace
    z = np.stack([B[..., 2, 1] - B[..., 1, 2], B[..., 0, 2] - B[..., 2, 0], B[..., 1, 0] - B[..., 0, 1]], axis=-1)
    K[..., 0, 1:] = K[..., 1:, 0] = z
    K[..., 1:, 1:] = B + np.swapaxes(B, -1, -2) - trace[..., None, None] * np.eye(3)
    q: np.ndarray = np.linalg.eigh(K)[1][..., :, 3]
    return q


def horn(body: np.ndarray, seen: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (..., 4) and shift (..., 3) with seen = shift + q body q*, weights (..., m) equal in all directions."""
    whole = np.sum(weight, axis=-1)[..., None]
    centre_body = np.einsum("...m,...mi->...i", weight, body) / whole
    centre_seen = np.einsum("...m,...mi->...i", weight, seen) / whole
    q = q_method(body - centre_body[..., None, :], seen - centre_seen[..., None, :], weight)
    return q, centre_seen - np.einsum("...ij,...j->...i", rotation_matrix(q), centre_body)


def spread_out(points: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Whether the points in use fix a rotation: three or more, not on a line. (..., m, 3) and (..., m) to (...)."""
    count = use.sum(axis=-1)
    solid = np.where(use[..., None], points, 0.0)
    middle = solid.sum(axis=-2) / np.maximum(count, 1)[..., None]
    arm = np.where(use[..., None], solid - middle[..., None, :], 0.0)
    sizes = np.linalg.eigvalsh(np.swapaxes(arm, -1, -2) @ arm)
    return np.asarray((count >= 3) & (sizes[..., 1] > LEAST_SPREAD**2 * sizes[..., 2]))


def align(
    body: np.ndarray,
    seen: np.ndarray,
    information: np.ndarray,
    use: np.ndarray,
    q: np.ndarray,
    shift: np.ndarray,
    soft: int = SOFT_ROUNDS,
    hard: int = HARD_ROUNDS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weighted least-squares pose from a near one, with the whole covariance of every point, for many epochs at once.

    Points beyond the one-in-a-thousand Mahalanobis distance are left out as long as three remain.

    Args:
        body: (m, 3); seen: (n, m, 3), anything where not used; information: (n, m, 3, 3) inverse covariance of seen;
        use: (n, m) which to take; q: (n, 4), shift: (n, 3) first guess; soft: rounds that lean on the points that fit
        best, for a guess that is far off; hard: rounds that leave outliers out.

    Returns:
        q (n, 4), shift (n, 3), covariance (n, 6, 6) of a small turn about the reference axes [rad] and of the
        shift [m], squared Mahalanobis distances (n, m), infinite where not used.
    """
    # few of many points are seen at a time: gather those
    most = max(int(use.sum(axis=1).max(initial=0)), 1)
    column = np.argsort(~use, axis=1, kind="stable")[:, :most]
    row = np.arange(len(use))[:, None]
    taken = use[row, column]
    points = np.where(taken[..., None], body[column], 0.0)
    target = np.where(taken[..., None], seen[row, column], 0.0)
    given = np.where(taken[..., None, None], information[row, column], 0.0)
    near = np.zeros(taken.shape)
    normal = np.zeros((len(q), 6, 6))
    for turn in range(soft + hard):
        arm = points @ np.swapaxes(rotation_matrix(q), 1, 2)
        error = target - shift[:, None] - arm
        near = _squares(error, given)
        distance = np.where(taken, near, np.inf)
        if turn < soft:
            # far from the answer everything is far off: lean on what is least so
            size = np.maximum(LARGEST_MAHALANOBIS, _middle(distance))[:, None]
            share = np.where(taken, 1.0 / (1.0 + near / size), 0.0)
        else:
            limit = np.maximum(LARGEST_MAHALANOBIS, 2.0 * _third_smallest(distance))
            share = (taken & (near <= limit[:, None])).astype(float)
        weight = given * share[..., None, None]
        cross = cross_matrix(arm)
        wc = weight @ cross
        normal[:, :3, :3] = (np.swapaxes(cross, -1, -2) @ wc).sum(axis=1)
        normal[:, 3:, :3] = -wc.sum(axis=1)
        normal[:, :3, 3:] = np.swapaxes(normal[:, 3:, :3], 1, 2)
        normal[:, 3:, 3:] = weight.sum(axis=1)
        we = (weight @ error[..., None])[..., 0]
        gradient = np.concatenate([np.cross(arm, we).sum(axis=1), we.sum(axis=1)], axis=1)
        covariance = inverse_of(normal)
        step = (covariance @ gradient[..., None])[..., 0]
        length = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
        step *= np.minimum(1.0, 0.3 / np.maximum(length, 1e-12))
        q = normalise(multiply(from_rotation_vector(step[:, :3]), q))
        shift = shift + step[:, 3:]
    out = np.full(use.shape, np.inf)
    # squares of the pose returned, not of the one before its last step
    arm = points @ np.swapaxes(rotation_matrix(q), 1, 2)
    near = _squares(target - shift[:, None] - arm, given)
    np.put_along_axis(out, column, np.where(taken, near, np.inf), axis=1)
    return q, shift, covariance, out


def _squares(error: np.ndarray, information: np.ndarray) -> np.ndarray:
    return np.asarray(((information @ error[..., None])[..., 0] * error).sum(axis=-1))


def inverse_of(normal: np.ndarray) -> np.ndarray:
    """Inverse of symmetric matrices (..., k, k) of mixed units; a direction without information gets none."""
    size = np.einsum("...ii->...i", normal)
    scale = np.sqrt(np.maximum(size, 1e-300))
    both = scale[..., :, None] * scale[..., None, :]
    unit = normal / both
    idle = size <= 0
    unit[..., np.arange(size.shape[-1]), np.arange(size.shape[-1])] += idle
    try:
        done: np.ndarray = np.linalg.inv(unit)
    except np.linalg.LinAlgError:
        done = np.full(unit.shape, np.nan)
    # the pseudo-inverse costs ten times as much, and only nearly singular matrices need it
    poor = ~(np.abs(done).max(axis=(-1, -2), initial=0.0) < LARGEST_INVERSE)
    if poor.any():
        done[poor] = np.linalg.pinv(unit[poor], rcond=1e-12, hermitian=True)
    done[..., np.arange(size.shape[-1]), np.arange(size.shape[-1])] -= idle
    return 0.5 * (done + np.swapaxes(done, -1, -2)) / both


def _middle(values: np.ndarray) -> np.ndarray:
    """Median of the finite values of each row, zero where there is none."""
    count = np.isfinite(values).sum(axis=1)
    middle = np.sort(values, axis=1)[np.arange(len(values)), np.maximum(count - 1, 0) // 2]
    return np.asarray(np.where(np.isfinite(middle), middle, 0.0))


def _third_smallest(values: np.ndarray) -> np.ndarray:
    k = min(2, values.shape[1] - 1)
    third: np.ndarray = np.partition(values, k, axis=1)[:, k]
    return np.where(np.isfinite(third), third, 0.0)


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3) with cross_matrix(v) a = v x a."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out
