"""The centre of mass: the point of a turning body whose path is smooth."""

from __future__ import annotations

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.quaternion import rotation_matrix

HIGHEST_DEGREE = 6
"""Of the polynomials that the centre's path may be."""


def centre_of_mass(
    times: np.ndarray, q: np.ndarray, origin: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The point fixed in the body whose path is a polynomial of the lowest degree that explains the data.

    Without force it is a straight line (feng2018 eq 17-20 over the whole record); on an orbit it bends slowly, which
    the turning of the body cannot imitate. The degree is chosen by the Bayesian information criterion.

    Args:
        times: (n,) [s]; q: (n, 4) body to camera; origin: (n, 3) of the body axes in the camera [m]; covariance:
        (n, 3, 3) of the origin [m^2].

    Returns:
        offset (3,) from the origin of the body axes, body axes [m]; position and velocity (n, 3) in the camera [m, m/s].
    """
    R = rotation_matrix(q)
    span = max(float(times[-1] - times[0]), 1e-9)
    tau = (times - times[0]) / span
    n = len(times)
    weight = inverse_of(covariance)
    use = np.ones(n, bool)
    best: tuple[float, int, np.ndarray] | None = None
    for degree in range(1, min(HIGHEST_DEGREE, max(1, n - 2)) + 1):
        x, each = _fit(R, tau, origin, weight * use[:, None, None], degree)
        if degree == 1:
            use = each < 25.0 * max(float(np.median(each)) / 2.366, 1e-12)
            x, each = _fit(R, tau, origin, weight * use[:, None, None], degree)
        square = float(np.sum(each[use]))
        count = 3 * int(use.sum())
        score = count * np.log(max(square / count, 1e-12)) + 3 * (degree + 2) * np.log(count)
        if best is None or score < best[0] - 10.0:
            best = (score, degree, x)
    assert best is not None
    _, degree, x = best
    c = x[3:].reshape(degree + 1, 3)
    powers = tau[:, None] ** np.arange(degree + 1)
    slopes = np.arange(1, degree + 1) * tau[:, None] ** np.arange(degree) / span
    return x[:3], powers @ c, slopes @ c[1:]


def _fit(
    R: np.ndarray, tau: np.ndarray, origin: np.ndarray, weight: np.ndarray, degree: int
) -> tuple[np.ndarray, np.ndarray]:
    """origin = path(t) - R offset: the offset and the path's coefficients, squares of each epoch."""
    n = len(tau)
    J = np.zeros((n, 3, 3 * (degree + 2)))
    J[:, :, :3] = -R
    for a in range(degree + 1):
        J[:, :, 3 + 3 * a : 6 + 3 * a] = (tau**a)[:, None, None] * np.eye(3)
    WJ = weight @ J
    x = inverse_of(np.einsum("nij,nik->jk", J, WJ)) @ np.einsum("nij,ni->j", WJ, origin)
    error = origin - J @ x
    return x, np.einsum("ni,nij,nj->n", error, weight, error)


def features_on_path(
    times: np.ndarray, q: np.ndarray, points: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Position (n, 3) and velocity (3,) of the centre of mass and features (m, 3) from it, of known attitude.

    Args:
        times: (n,); q: (n, 4) body to camera; points: (n, m, 3) measured in the camera, NaN where not; covariance
        (n, m, 3, 3).
    """
    seen = np.isfinite(points).all(axis=-1)
    enough = seen.sum(axis=0) >= 3
    if not enough.any():
        return None
    R = rotation_matrix(q)
    weight = np.zeros_like(covariance)
    weight[seen] = inverse_of(covariance[seen])
    solid = np.where(seen[..., None], points, 0.0)
    body = np.full((points.shape[1], 3), np.nan)
    body[np.argmax(seen.sum(axis=0))] = 0.0
    origin = np.zeros((len(times), 3))
    spread = np.zeros((len(times), 3, 3))
    for _ in range(12):
        known = np.isfinite(body).all(axis=-1)
        W = weight * (seen & known)[..., None, None]
        arm = np.einsum("nij,mj->nmi", R, np.where(known[:, None], body, 0.0))
        spread = inverse_of(W.sum(axis=1))
        origin = np.einsum("nij,nj->ni", spread, np.einsum("nmij,nmj->ni", W, solid - arm))
        placed = (seen & known).any(axis=1)
        turned = np.swapaxes(R, 1, 2)[:, None] @ (weight * (seen & placed[:, None])[..., None, None])
        total = (turned @ R[:, None]).sum(axis=0)
        side = np.einsum("nmij,nmj->mi", turned, solid - origin[:, None])
        some = (seen & placed[:, None]).any(axis=0)
        body = np.where(some[:, None], np.einsum("mij,mj->mi", inverse_of(total), side), np.nan)
    placed = (seen & np.isfinite(body).all(axis=-1)).any(axis=1)
    if placed.sum() < 4:
        return None
    offset, path, velocity = centre_of_mass(times[placed], q[placed], origin[placed], spread[placed])
    position = np.stack([np.interp(times, times[placed], path[:, i]) for i in range(3)], axis=1)
    return position, velocity[0], np.where(enough[:, None], body - offset, np.nan)
