"""The rotation and shift between two sets of the same points."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix

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
    from massprops.estimators.geometry.alignment_kernel import aligned

    third = min(2, max(int(use.sum(axis=1).max(initial=0)), 1) - 1)
    q, shift = np.array(q, float), np.array(shift, float)
    covariance, near = aligned(
        np.ascontiguousarray(body, float),
        np.ascontiguousarray(seen, float),
        np.ascontiguousarray(information, float),
        np.ascontiguousarray(use),
        q,
        shift,
        soft,
        hard,
        LARGEST_MAHALANOBIS,
        third,
    )
    return q, shift, covariance, near


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
    found: np.ndarray = 0.5 * (done + np.swapaxes(done, -1, -2)) / both
    return found
