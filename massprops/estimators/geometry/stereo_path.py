"""Centre of mass, its path and the features from stereo points of a body whose attitude is known: linear."""

from __future__ import annotations

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.chaser_path import ChaserPath, transitions
from massprops.dynamics.quaternion import rotation_matrix

LARGEST_SQUARE = 16.3
"""Squared Mahalanobis distance in three dimensions that one in a thousand good points exceeds."""


def path_transition(times: np.ndarray, path: ChaserPath) -> np.ndarray:
    """(n, 3, 6): position at each time by position and velocity at the first, inertial axes."""
    out = [np.eye(6)]
    for F in transitions(path, times):
        out.append(F @ out[-1])
    return np.stack(out)[:, :3]


def linear_path(
    times: np.ndarray, q: np.ndarray, points: np.ndarray, covariance: np.ndarray, path: ChaserPath, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Least squares for x = (position 3, velocity 3 at times[0], features 3 m) with every point's own weight.

    Args:
        times: (n,); q: (n, 4) body to inertial; points: (n, m, 3) in inertial axes from the chaser, NaN where not
        seen; covariance: (n, m, 3, 3) of them [m^2]; path: the chaser's; size: 1-sigma of a feature's place [m],
        which holds the centre of mass where the motion does not show it.

    Returns:
        x (6 + 3 m,) and its covariance.
    """
    n, m = points.shape[:2]
    seen = np.isfinite(points).all(axis=-1) & np.isfinite(covariance).all(axis=(-1, -2))
    weight = np.zeros((n, m, 3, 3))
    weight[seen] = inverse_of(covariance[seen])
    z = np.where(seen[..., None], points, 0.0)
    R, T = rotation_matrix(q), path_transition(times, path)
    prior = np.concatenate([np.zeros(6), np.full(3 * m, size**-2)])
    keep = seen.astype(float)
    for _ in range(3):
        W = weight * keep[..., None, None]
        total = W.sum(axis=1)
        N = np.diag(prior)
        b = np.zeros(6 + 3 * m)
        N[:6, :6] += np.einsum("nia,nij,njb->ab", T, total, T, optimize=True)
        b[:6] = np.einsum("nia,nmij,nmj->a", T, W, z, optimize=True)
        WR = W @ R[:, None]
        cross = np.einsum("nia,nmij->maj", T, WR, optimize=True)
        feature_blocks = np.einsum("nji,nmjk->mik", R, WR, optimize=True)
        right = np.einsum("nmji,nmj->mi", WR, z)
        for i in range(m):
            s = slice(6 + 3 * i, 9 + 3 * i)
            N[:6, s], N[s, :6] = cross[i], cross[i].T
            N[s, s] += feature_blocks[i]
            b[s] = right[i]
        spread = inverse_of(N)
        x = spread @ b
        error = z - (T @ x[:6])[:, None] - np.einsum("nij,mj->nmi", R, x[6:].reshape(m, 3))
        square = np.einsum("nmi,nmij,nmj->nm", error, weight, error)
        limit = LARGEST_SQUARE * max(1.0, float(np.median(square[seen])) / 2.366)
        keep = (seen & (square < limit)).astype(float)
    factor = max(1.0, float(np.median(square[seen])) / 2.366)
    return x, spread * factor
