"""Two cameras: the point that both see, and how far it can be trusted."""

from __future__ import annotations

import numpy as np

from massprops.sensing.pinhole import Pinhole

ROUNDS = 4
SIGNIFICANT = 3.0
"""An inverse depth must stand this many sigma above zero, or the point may lie anywhere out to infinity."""
LARGEST_MISS = 5.0
"""Sigma by which two rays may miss each other: four numbers measured, three sought."""


def triangulate(
    cameras: tuple[Pinhole, ...], uv: np.ndarray, sigma_px: np.ndarray, largest_miss: float = LARGEST_MISS
) -> tuple[np.ndarray, np.ndarray]:
    """Points seen by two cameras of any poses, with covariance, by least squares in the image.

    The unknowns are the bearing and the inverse depth in the first camera, in which the pixels are nearly linear, so
    that the covariance of a far point is right.

    Args:
        cameras: two pinholes.
        uv: (..., 2, 2) pixels in the first and second camera, NaN where not seen.
        sigma_px: (2,) 1-sigma of a pixel in each.
        largest_miss: sigma by which the two rays may miss each other, beyond which one of them saw something else.

    Returns:
        points (..., 3) in the chaser's frame [m] and covariance (..., 3, 3) [m^2]; NaN where not seen by
        both, where the rays miss each other, behind a camera, or too far for the baseline to tell.
    """
    one, two = cameras
    uv = np.asarray(uv, float)
    a = (uv[..., 0, :] - one.intrinsics[2:]) / one.intrinsics[:2]
    b = (uv[..., 1, :] - two.intrinsics[2:]) / two.intrinsics[:2]
    sigma_a, sigma_b = sigma_px[0] / one.intrinsics[:2], sigma_px[1] / two.intrinsics[:2]
    turn = two.R @ one.R.T
    shift = two.R @ (one.t - two.t)
    # in the second camera the point is, up to scale, turn (x, y, 1) + s shift, with s the inverse depth in the first
    ray = _homogeneous(a) @ turn.T
    rows = b * ray[..., 2:] - ray[..., :2]
    slope = shift[:2] - b * shift[2]
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.sum(slope * rows, axis=-1) / np.sum(slope * slope, axis=-1)
    begin = np.concatenate([a, s[..., None]], axis=-1)
    weight = 1.0 / np.concatenate([sigma_a, sigma_b])
    state, covariance, good = _least_squares(begin, a, b, weight, (turn, shift))
    seen = _second(state, turn, shift)[0]
    miss = np.sum((np.concatenate([a - state[..., :2], b - seen], axis=-1) * weight) ** 2, axis=-1)
    depth = 1.0 / np.where(state[..., 2] > 0, state[..., 2], np.nan)
    bearing = _homogeneous(state[..., :2])
    behind = (bearing @ turn.T + state[..., 2:] * shift)[..., 2] <= 0
    vague = state[..., 2] < SIGNIFICANT * np.sqrt(covariance[..., 2, 2])
    lost = ~good | ~(miss < largest_miss**2) | behind | vague | ~np.isfinite(depth)
    lever = np.zeros((*depth.shape, 3, 3))
    lever[..., 0, 0] = lever[..., 1, 1] = depth
    lever[..., :, 2] = -bearing * (depth * depth)[..., None]
    lever = one.R.T @ lever
    points = (bearing * depth[..., None]) @ one.R + one.t
    spread = lever @ covariance @ np.swapaxes(lever, -1, -2)
    return np.where(lost[..., None], np.nan, points), np.where(lost[..., None, None], np.nan, spread)


def _least_squares(
    state: np.ndarray, a: np.ndarray, b: np.ndarray, weight: np.ndarray, pose: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bearing and inverse depth (..., 3), their covariance (..., 3, 3), and where they are numbers at all.

    Args:
        a, b: (..., 2) normalised image points; weight: (4,) one over their 1-sigma; pose: turn and shift.
    """
    for _ in range(ROUNDS):
        seen, J = _second(state, *pose)
        error = np.concatenate([a - state[..., :2], b - seen], axis=-1) * weight
        full = np.zeros((*state.shape[:-1], 4, 3))
        full[..., 0, 0] = full[..., 1, 1] = 1.0
        full[..., 2:, :] = J
        full *= weight[:, None]
        normal = np.swapaxes(full, -1, -2) @ full
        good = np.isfinite(normal).all(axis=(-1, -2)) & np.isfinite(error).all(axis=-1)
        normal = np.where(good[..., None, None], normal, np.eye(3))
        scale = np.sqrt(np.einsum("...ii->...i", normal))
        unit = normal / (scale[..., :, None] * scale[..., None, :])
        try:
            inverse = np.linalg.inv(unit)
        except np.linalg.LinAlgError:
            inverse = np.linalg.pinv(unit, hermitian=True)
        covariance = inverse / (scale[..., :, None] * scale[..., None, :])
        gradient = np.einsum("...ij,...i->...j", full, np.where(good[..., None], error, 0.0))
        state = state + np.einsum("...ij,...j->...i", covariance, gradient)
    return state, covariance, good


def _homogeneous(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x, np.ones_like(x[..., :1])], axis=-1)


def _second(state: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised image point (..., 2) in the second camera and its derivative (..., 2, 3) by the state."""
    Y = _homogeneous(state[..., :2]) @ turn.T + state[..., 2:] * shift
    depth = np.where(np.abs(Y[..., 2:]) > 1e-12, Y[..., 2:], np.nan)
    x = Y[..., :2] / depth
    by = np.concatenate([turn[:, :2], shift[:, None]], axis=1)
    return x, (by[:2] - x[..., :, None] * by[2]) / depth[..., None]
