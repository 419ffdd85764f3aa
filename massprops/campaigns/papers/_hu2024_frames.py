"""The principal frame as data come in (hu2024 section 3): momentum least squares on all epochs so far, many runs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.alignment import align, horn
from massprops.dynamics.inertia import DIRECTIONS
from massprops.dynamics.quaternion import conjugate, multiply, rotation_matrix, rotation_vector
from massprops.estimators.unique_frame import SignRule, sign_rule, unique_frame

SURE_AXES = np.radians(5.0)
"""1-sigma of the axes below which the frame is adopted and its sign rule kept."""
SURE_GAP = 5.0
"""Sigmas by which the moments must differ then."""
STEADY = np.radians(10.0)
"""Turn of the axes that must not have been exceeded for a while before: errors of attitudes that share a shape are alike
over seconds, which the covariance of the fit does not know."""


def attitude_of_points(points: np.ndarray, information: np.ndarray, early: int) -> np.ndarray:
    """Attitude (n, 4) of points (n, m, 3) against their mean shape in the first `early` epochs, by their own weights:
    a stereo point is known across the line of sight many times better than along it."""
    n, m = points.shape[:2]
    use = np.ones((n, m), bool)
    shape = points[0] - points[0].mean(axis=0)
    for last in (early, early, early, n):
        p, W = points[:last], information[:last]
        q, shift = horn(np.broadcast_to(shape, p.shape), p, np.ones(p.shape[:2]))
        q, shift, _, _ = align(shape, p, W, use[:last], q, shift)
        if last < n or early == n:
            R = rotation_matrix(q)[:, None]
            turned = np.swapaxes(R, -1, -2) @ W
            right = np.einsum("nmij,nmj->mi", turned, p - shift[:, None])
            shape = np.einsum("mij,mj->mi", inverse_of((turned @ R).sum(axis=0)), right)
    return q


def local_rates(times: np.ndarray, q: np.ndarray, half: int, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Body rates at every `every`-th epoch, by cubic fits to the rotation vectors of its neighbours (hu2024 eq 15).

    Args:
        times: (n,) [s]; q: (..., n, 4), NaN where not measured; half: neighbours on each side.

    Returns:
        place (p,) of the epochs and w (..., p, 3) [rad/s], NaN where a neighbour lacks.
    """
    place = np.arange(half, len(times) - half, every)
    near = place[:, None] + np.arange(-half, half + 1)
    tau = times[near] - times[place][:, None]
    A = tau[..., None] ** np.arange(1, 4)
    A = np.concatenate([np.ones_like(A[..., :1]), A], axis=-1)
    solver = np.linalg.pinv(A)
    turn = rotation_vector(multiply(conjugate(q[..., place, None, :]), q[..., near, :]))
    offset = np.einsum("pj,...pjc->...pc", solver[:, 0], turn)
    slope = np.einsum("pj,...pjc->...pc", solver[:, 1], turn)
    # the fit's own attitude at the centre is off by `offset`, in whose axes the rate is wanted
    return place, slope - 0.5 * np.cross(offset, slope)


@dataclass(frozen=True)
class Growth:
    """b runs, p times: inertia (b, p, 3, 3) with trace 1; covariance (b, p, 5, 5) along `momentum.DIRECTIONS`; count
    (b, p) of the epochs used."""

    inertia: np.ndarray
    covariance: np.ndarray
    count: np.ndarray


def growing_inertia(q: np.ndarray, w: np.ndarray, correlation: float) -> Growth:
    """Momentum least squares (hu2024 eq 10-14, trace 1 in place of I_xx = 1) on the epochs up to each one.

    Args:
        q: (b, p, 4) body to inertial; w: (b, p, 3) body rates; rows with NaN are passed over.
        correlation: epochs over which rates share measurements.
    """
    there = np.isfinite(q).all(axis=-1) & np.isfinite(w).all(axis=-1)
    R = rotation_matrix(np.where(there[..., None], q, [1.0, 0, 0, 0]))
    w = np.where(there[..., None], w, 0.0)
    by_inertia = R @ np.moveaxis(np.einsum("aij,...j->...ai", DIRECTIONS, w), -1, -2)
    by_momentum = np.broadcast_to(-np.eye(3), R.shape) * there[..., None, None]
    J = np.concatenate([by_inertia, by_momentum], axis=-1)
    b = -np.einsum("...ij,...j->...i", R, w) / 3.0
    normal = np.cumsum(np.swapaxes(J, -1, -2) @ J, axis=1)
    right = np.cumsum(np.einsum("...ia,...i->...a", J, b), axis=1)
    square = np.cumsum(np.sum(b * b, axis=-1), axis=1)
    rows = 3.0 * np.cumsum(there, axis=1)
    scale = np.sqrt(np.maximum(np.einsum("...aa->...a", normal), 1e-300))
    inverse = np.linalg.pinv(normal / (scale[..., :, None] * scale[..., None, :]), rcond=1e-10, hermitian=True)
    inverse = inverse / (scale[..., :, None] * scale[..., None, :])
    x = np.einsum("...ab,...b->...a", inverse, right)
    rest = np.maximum(square - np.einsum("...a,...a->...", x, right), 0.0)
    variance = rest / np.maximum(rows - 8.0, 1.0) * correlation
    inertia = np.eye(3) / 3.0 + np.einsum("...a,aij->...ij", x[..., :5], DIRECTIONS)
    covariance = variance[..., None, None] * inverse[..., :5, :5]
    covariance[rows <= 24] = np.inf
    return Growth(inertia, covariance, np.cumsum(there, axis=1))


@dataclass(frozen=True)
class Frames:
    """b runs, p times.

    Attributes:
        unique: (b, p, 3, 3) axes in body axes by the mended rule, whose deciding components are kept once adopted;
        memoryless: the same with the largest components decided anew each time; paper: by the paper's rule.
        adopted: (b,) number of the time when the frame was adopted, p when never.
        rule: components that decide, (b,).
    """

    unique: np.ndarray
    memoryless: np.ndarray
    paper: np.ndarray
    adopted: np.ndarray
    rule: SignRule


def determined_frames(growth: Growth, lasting: int) -> Frames:
    """The principal frame at every time, adopted when its axes and the order of its moments are sure, and were and lay
    still over the last `lasting` epochs with measurements."""
    moments, axes = np.linalg.eigh(growth.inertia)
    local = np.einsum("...ia,nij,...jb->...nab", axes, DIRECTIONS, axes)
    sure = np.ones(moments.shape[:-1], bool)
    finite = np.isfinite(growth.covariance).all(axis=(-1, -2))
    covariance = np.where(finite[..., None, None], growth.covariance, 0.0)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        gap = moments[..., j] - moments[..., i]
        turn = local[..., i, j] / np.maximum(gap, 1e-12)[..., None]
        change = local[..., j, j] - local[..., i, i]
        sure &= np.einsum("...a,...ab,...b->...", turn, covariance, turn) < SURE_AXES**2
        sure &= np.einsum("...a,...ab,...b->...", change, covariance, change) * SURE_GAP**2 < gap**2
    sure &= finite & (moments[..., 0] > 0)
    sure = _steady(sure, axes, growth.count, lasting)
    count = moments.shape[1]
    adopted = np.where(sure.any(axis=1), np.argmax(sure, axis=1), count)
    at = np.minimum(adopted, count - 1)
    rule = sign_rule(growth.inertia[np.arange(len(at)), at])
    spread = SignRule(*(np.broadcast_to(r[:, None], sure.shape) for r in (rule.x, rule.z)))
    return Frames(
        unique_frame(growth.inertia, spread)[1],
        unique_frame(growth.inertia)[1],
        paper_frame(growth.inertia)[1],
        adopted,
        rule,
    )


def _steady(sure: np.ndarray, axes: np.ndarray, count: np.ndarray, lasting: int) -> np.ndarray:
    """(b, p) True where all was sure, and the axes lay still, at every time over the last `lasting` epochs used."""
    out = sure & (count > lasting)
    for back in range(1, sure.shape[1]):
        recent = count[:, back:] - count[:, :-back] <= lasting
        if not recent.any():
            break
        cosine = np.abs(np.einsum("bpij,bpij->bpj", axes[:, back:], axes[:, :-back])).min(axis=-1)
        out[:, back:] &= ~recent | (sure[:, :-back] & (cosine > np.cos(STEADY)))
    return out


def paper_frame(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The paper's rule as printed, for comparison with `unique_frame`: r3 keeps whatever sign the eigenvalue routine gave it."""
    moments, axes = np.linalg.eigh(inertia)
    x = axes[..., 2] * np.where(axes[..., :1, 2] < 0, -1.0, 1.0)
    z = axes[..., 0]
    return moments[..., ::-1], np.stack([x, np.cross(z, x), z], axis=-1)
