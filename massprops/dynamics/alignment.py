"""The rotation and shift between two sets of the same points."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import nearest_rotation, rotation_matrix

SOFT_ROUNDS = 4
HARD_ROUNDS = 3
LARGEST_MAHALANOBIS = 16.27
"""Squared Mahalanobis distance of a point in three dimensions that one in a thousand good points exceeds."""
LEAST_SPREAD = 1e-3
"""Second singular value of a point set over its first, below which the points lie on a line."""
SAME_BODY = 0.1
"""Largest median residual of common features, over their spread, at which they are the same points."""


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
    return np.linalg.eigh(K)[1][..., :, 3]


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
    from massprops.dynamics.alignment_kernel import aligned

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


def similarity(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray] | None:
    """Scale and rotation (3, 3) of target = scale R source + t by least squares (Umeyama 1991), twice, the second time
    without the worst; None when the points are not the same body's.

    Args:
        source, target: (n, 3), n >= 4.
    """
    keep = np.ones(len(source), bool)
    for _ in range(3):
        a, b = source[keep] - source[keep].mean(0), target[keep] - target[keep].mean(0)
        R = nearest_rotation(b.T @ a)
        scale = float(np.sum(R * (b.T @ a)) / max((a * a).sum(), 1e-300))
        shift = target[keep].mean(0) - scale * R @ source[keep].mean(0)
        apart = np.linalg.norm(target - scale * source @ R.T - shift, axis=1)
        middle = float(np.median(apart[keep]))
        keep = apart <= max(3.0 * middle, 1e-12)
        if keep.sum() < 4:
            return None
    spread = float(np.sqrt(np.mean(np.sum((target[keep] - target[keep].mean(0)) ** 2, axis=1))))
    d = np.linalg.svd(b.T @ a, compute_uv=False)
    flat = d[1] < 1e-6 * d[0] if d[0] > 0 else True
    if flat or scale <= 0 or middle > SAME_BODY * max(spread, 1e-300):
        return None
    return scale, R
