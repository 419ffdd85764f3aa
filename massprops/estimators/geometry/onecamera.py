"""Features and path from one camera when the attitude is known: linear, up to scale."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix
from massprops.model.problem import Problem

ROUNDS = 8
MOST_FEATURES = 120


def straight_path(
    problem: Problem, rows: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool] | None:
    """Path of the centre of mass and the features, of a body that turns as known while its centre moves straight.

    Every pixel gives two equations that are linear in the path's start and velocity and the feature's place; all
    together fix them up to one factor, which range0 gives. Equations are weighted by their depth and Huber's rule.

    Args:
        rows: (k,) epochs of the problem; q: (k, 4) body to cam0 there.

    Returns:
        position (k, 3), velocity (3,), features (m, 3) with NaN where not seen, whether in metres; None when the
        tracks do not fix them.
    """
    times = problem.times[rows]
    span = max(float(times[-1] - times[0]), 1e-9)
    tau = (times - times[0]) / span
    uv = problem.uv[rows, 0]
    seen = np.isfinite(uv).all(axis=-1)
    enough = np.flatnonzero(seen.sum(axis=0) >= 3)
    if len(enough) < 3:
        return None
    chosen = enough[np.argsort(-seen[:, enough].sum(axis=0), kind="stable")[:MOST_FEATURES]]
    for moving in (True, False):
        done = _solve(problem, q, tau, uv, chosen, moving)
        if done is not None:
            break
    else:
        return None
    x, points = done
    features = np.full((uv.shape[1], 3), np.nan)
    features[chosen] = points
    position = x[:3] + tau[:, None] * x[3:]
    ranges = problem.range_m[rows]
    ok = np.isfinite(ranges)
    size, scaled = 1.0 / max(float(np.linalg.norm(x[:3])), 1e-12), False
    if ok.any():
        size = float(np.median(ranges[ok] / np.linalg.norm(position[ok], axis=1)))
        scaled = True
    return position * size, x[3:] / span * size, features * size, scaled


def _solve(
    problem: Problem, q: np.ndarray, tau: np.ndarray, uv: np.ndarray, chosen: np.ndarray, moving: bool
) -> tuple[np.ndarray, np.ndarray] | None:
    """Path (6,) and features (m, 3) with the path's start one long, or None when behind the camera or degenerate."""
    camera = problem.cameras[0]
    k, j = np.nonzero(np.isfinite(uv[:, chosen]).all(axis=-1))
    x = (uv[k, chosen[j]] - camera.intrinsics[2:]) / camera.intrinsics[:2]
    sigma = problem.sigma_px[0] / camera.intrinsics[0]
    R = rotation_matrix(q)[k]
    select = np.zeros((len(k), 2, 3))
    select[:, 0, 0] = select[:, 1, 1] = -1.0
    select[:, :, 2] = x
    by_path = np.concatenate([select, select * tau[k][:, None, None]], axis=2)[:, :, : 6 if moving else 3]
    by_point = select @ R
    weight = np.ones(len(k))
    p = by_path.shape[2]
    path, points = np.zeros(p), np.zeros((len(chosen), 3))
    for turn in range(ROUNDS):
        w = (weight**2)[:, None, None]
        A = np.einsum("nip,niq->pq", by_path * w, by_path)
        B = np.zeros((len(chosen), p, 3))
        C = np.zeros((len(chosen), 3, 3))
        np.add.at(B, j, np.swapaxes(by_path * w, 1, 2) @ by_point)
        np.add.at(C, j, np.swapaxes(by_point * w, 1, 2) @ by_point)
        if not (np.isfinite(A).all() and np.isfinite(C).all()):
            return None
        inner = np.linalg.pinv(C, rcond=1e-12, hermitian=True)
        reduced = A - np.einsum("mpi,mij,mqj->pq", B, inner, B)
        scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
        values, vectors = np.linalg.eigh(reduced / np.outer(scale, scale))
        if not values[1] > 4.0 * max(values[0], 0.0):
            return None
        path = vectors[:, 0] / scale
        path = path / np.linalg.norm(path[:3]) * (1.0 if path[2] >= 0 else -1.0)
        points = -np.einsum("mij,mpj,p->mi", inner, B, path)
        depth = _depth(R, points[j], path, tau[k])
        if np.mean(depth > 0) < 0.9 and turn:
            return None
        depth = np.maximum(depth, 1e-3)
        error = (by_path @ path + np.einsum("nij,nj->ni", by_point, points[j])) / depth[:, None]
        size = np.linalg.norm(error, axis=1)
        limit = 2.5 * max(1.2 * float(np.median(size)), sigma)
        weight = np.sqrt(np.minimum(1.0, limit / np.maximum(size, 1e-300))) / depth * (size < 4 * limit)
    return np.concatenate([path, np.zeros(6 - p)]), points


def _depth(R: np.ndarray, points: np.ndarray, path: np.ndarray, tau: np.ndarray) -> np.ndarray:
    moved = path[2] + (tau * path[5] if len(path) == 6 else 0.0)
    return np.einsum("ni,ni->n", R[:, 2], points) + moved
