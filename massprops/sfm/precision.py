"""How well the adjustment fixes the focal length and each attitude, from the measured residuals.

A track's observations share their errors (a feature on a curved edge or a moving shadow slides the same way in every
frame), so the usual inverse normal matrix is too confident. The covariance here is the sandwich with tracks as
clusters: Cov = H⁺ (Σ_p s_p s_pᵀ) H⁺, H the camera system after the points are eliminated, s_p the score of track p
(Huber 1967; Liang and Zeger 1986, eq. 5).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from massprops.sfm.points import SparsePoints, residuals
from massprops.views import Views


@dataclass(frozen=True)
class Precision:
    """Standard deviations at the end of an adjustment.

    Attributes:
        rms_px: root mean square residual of one coordinate [px].
        focal_relative: of the focal length, relative; 0 when it was given. Of several cameras, the one with most views.
        distortion: of its k1; 0 when it was not estimated.
        attitude: (n,) of each view's rotation, per axis [rad].
        focal_relative_model: what independent errors of size `rms_px` would give for `focal_relative`.
        focal_by_camera: relative, of every camera number.
    """

    rms_px: float
    focal_relative: float
    distortion: float
    attitude: np.ndarray
    focal_relative_model: float
    focal_by_camera: dict[int, float] = field(default_factory=dict)


def precision(
    views: Views,
    points: SparsePoints,
    free_focal: bool,
    radial_terms: int | dict[int, int],
    loss_px: float | None = None,
    camera: np.ndarray | None = None,
    constant: frozenset[int] = frozenset(),
) -> Precision:
    """See the module.

    Args:
        free_focal: whether focal lengths were estimated.
        radial_terms: estimated terms of the distortion, of all cameras or by number.
        loss_px: scale of the Cauchy loss of the adjustment, None for least squares.
        camera: (n,) number of each view's camera; None for one camera.
        constant: numbers of cameras whose focal length was given all the same.
    """
    import scipy.linalg
    import scipy.sparse as sp

    n, m, k = len(views), len(points.xyz), len(points.obs_view)
    v, p = points.obs_view, points.obs_point
    r = residuals(views, points)
    rms = float(np.sqrt(np.mean(r**2))) if k else float("nan")
    camera = np.zeros(n, int) if camera is None else np.asarray(camera)
    numbers, many = np.unique(camera, return_counts=True)
    main = int(np.argmax(many)) if n else 0
    if n < 3 or k < 6 * n:
        return Precision(rms, np.nan if free_focal else 0.0, np.nan, np.full(n, np.nan), np.nan)
    w = np.ones(k) if loss_px is None else 1 / (1 + (r**2).sum(1) / loss_px**2)
    R, K, D = views.R[v], views.K[v], views.distortion[v]
    a = np.einsum("kij,kj->ki", R, points.xyz[p])
    c = a + views.t[v]
    x, y, z = c[:, 0] / c[:, 2], c[:, 1] / c[:, 2], c[:, 2]
    r2 = x * x + y * y
    radial = 1 + r2 * (D[:, 0] + r2 * D[:, 1])
    f = K[:, 0, 0]
    # tangential terms are left out of the derivatives only: they are far below the rest
    g = D[:, 0] + 2 * r2 * D[:, 1]
    dx = np.stack([radial + 2 * x * x * g, 2 * x * y * g], 1)
    dy = np.stack([2 * x * y * g, radial + 2 * y * y * g], 1)
    Jn = np.stack([dx, dy], 1) * f[:, None, None]
    Jc = np.einsum(
        "kij,kjl->kil",
        Jn,
        np.stack(
            [
                np.stack([1 / z, 0 * z, -x / z], 1),
                np.stack([0 * z, 1 / z, -y / z], 1),
            ],
            1,
        ),
    )
    cross = np.zeros((k, 3, 3))
    cross[:, 0, 1], cross[:, 0, 2] = a[:, 2], -a[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = -a[:, 2], a[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = a[:, 1], -a[:, 0]
    pose = np.concatenate([Jc @ cross, Jc], 2)
    extra, focal_at, bent_at = [], {}, {}
    for c in numbers.tolist():
        own = (camera[v] == c)[:, None]
        if free_focal and c not in constant:
            focal_at[c] = len(extra)
            extra.append(np.where(own, np.stack([x * radial, y * radial], 1) * f[:, None], 0.0))
        terms = radial_terms if isinstance(radial_terms, int) else radial_terms.get(c, 0)
        for power in range(1, terms + 1):
            bent_at.setdefault(c, len(extra))
            extra.append(np.where(own, np.stack([x * r2**power, y * r2**power], 1) * f[:, None], 0.0))
    e = len(extra)
    rows = np.arange(2 * k).reshape(k, 2)
    cols = 6 * v[:, None] + np.arange(6)
    parts_r = [np.repeat(rows[:, :, None], 6, 2).ravel()]
    parts_c = [np.repeat(cols[:, None, :], 2, 1).ravel()]
    parts_v = [pose.ravel()]
    for i, column in enumerate(extra):
        parts_r.append(rows.ravel())
        parts_c.append(np.full(2 * k, 6 * n + i))
        parts_v.append(column.ravel())
    size = 6 * n + e
    A = sp.csr_matrix((np.concatenate(parts_v), (np.concatenate(parts_r), np.concatenate(parts_c))), (2 * k, size))
    pc = np.repeat((3 * p[:, None] + np.arange(3))[:, None, :], 2, 1).ravel()
    B = sp.csr_matrix(((Jc @ R).ravel(), (np.repeat(rows[:, :, None], 3, 2).ravel(), pc)), (2 * k, 3 * m))
    W = sp.diags(np.repeat(w, 2))
    AW = (A.T @ W).tocsr()
    V = np.zeros((m, 3, 3))
    np.add.at(V, p, np.einsum("k,kia,kib->kab", w, Jc @ R, Jc @ R))
    V += np.eye(3) * 1e-12 * np.trace(V, axis1=1, axis2=2)[:, None, None]
    Vinv = sp.bsr_matrix((np.linalg.inv(V), np.arange(m), np.arange(m + 1)), (3 * m, 3 * m))
    C = (AW @ B).tocsr()
    H = np.asarray((AW @ A).todense() - (C @ Vinv @ C.T).todense())
    # score of each track with its point eliminated; the eliminated part vanishes at the optimum, and is kept near it
    track = sp.csr_matrix((np.ones(2 * k), (np.repeat(p, 2), np.arange(2 * k))), (m, 2 * k))
    rw = sp.diags((r * w[:, None]).ravel())
    S = (track @ rw @ A).tocsr()
    b = np.zeros((m, 3))
    np.add.at(b, p, np.einsum("k,kia,ki->ka", w, Jc @ R, r))
    back = sp.bsr_matrix((b[:, None, :], np.arange(m), np.arange(m + 1)), (m, 3 * m))
    S = S - back @ Vinv @ C.T
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = scipy.linalg.eigh(H * scale[:, None] * scale)
    keep = np.arange(len(values)) >= 7  # rotation, translation and scale of the whole are free
    inverse = (vectors[:, keep] / np.maximum(values[keep], 1e-14)) @ vectors[:, keep].T
    inverse *= scale[:, None] * scale
    meat = np.asarray((S.T @ S).todense())
    cov = inverse @ meat @ inverse
    diag = np.sqrt(np.maximum(np.diag(cov), 0))
    plain = np.sqrt(np.maximum(np.diag(inverse), 0)) * rms
    attitude = np.sqrt(np.mean(diag[: 6 * n].reshape(n, 6)[:, :3] ** 2, axis=1))
    first = int(numbers[main])
    by_camera = {c: float(diag[6 * n + i]) for c, i in focal_at.items()}
    return Precision(
        rms_px=rms,
        focal_relative=by_camera.get(first, 0.0),
        distortion=float(diag[6 * n + bent_at[first]]) if first in bent_at else 0.0,
        attitude=attitude,
        focal_relative_model=float(plain[6 * n + focal_at[first]]) if first in focal_at else 0.0,
        focal_by_camera=by_camera,
    )
