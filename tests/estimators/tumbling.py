"""A small tumbling body before one or two cameras, with truth beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics import quaternion
from massprops.dynamics.inertia import ratios
from massprops.dynamics.rigid_body import propagate
from massprops.model.problem import Problem
from massprops.sensing.pinhole import Pinhole, project


@dataclass(frozen=True)
class Scene:
    problem: Problem
    q: np.ndarray
    w: np.ndarray
    r: np.ndarray
    k: np.ndarray
    axes: np.ndarray


def scene(
    seed: int = 0,
    n: int = 240,
    dt: float = 0.5,
    stereo: bool = True,
    attitude: bool = False,
    range_sigma: float = 0.0,
    outliers: float = 0.0,
    gap: tuple[int, int] | None = None,
    spin: tuple[float, float, float] = (0.02, 0.1, 0.03),
    moments: tuple[float, float, float] = (0.25, 0.35, 0.4),
) -> Scene:
    rng = np.random.default_rng(seed)
    axes = quaternion.rotation_matrix(quaternion.normalise(rng.standard_normal(4)))
    inertia = axes @ np.diag(moments) @ axes.T
    t = np.arange(n) * dt
    q, w = propagate(quaternion.normalise(rng.standard_normal(4)), axes @ np.array(spin), inertia, t, compiled=True)
    r = np.array([0.3, -0.2, 12.0]) + t[:, None] * np.array([0.002, -0.001, 0.003])
    points = rng.uniform(-1.2, 1.2, (10, 3))
    R = quaternion.rotation_matrix(q)
    lens = np.array([1000.0, 1000.0, 640.0, 480.0])
    cameras = tuple(Pinhole(lens, np.eye(3), np.array([b, 0.0, 0.0])) for b in ((0.0, 1.0) if stereo else (0.0,)))
    X = r[:, None] + np.einsum("nij,mj->nmi", R, points)
    uv = np.stack([project(camera, X) for camera in cameras], axis=1)
    uv += 0.3 * rng.standard_normal(uv.shape)
    wild = rng.random(uv.shape[:3]) < outliers
    uv[wild] += rng.uniform(-80, 80, (int(wild.sum()), 2))
    away = np.einsum("nij,mj->nmi", R, points / np.linalg.norm(points, axis=1, keepdims=True))[..., 2] > 0.5
    uv[np.broadcast_to(away[:, None], uv.shape[:3])] = np.nan
    if gap:
        uv[gap[0] : gap[1]] = np.nan
    seen_q, sigma_q = np.full((n, 4), np.nan), np.full(n, np.nan)
    if attitude:
        seen_q = quaternion.multiply(q, quaternion.from_rotation_vector(0.003 * rng.standard_normal((n, 3))))
        sigma_q[:] = 0.003
    ranges = np.full(n, np.nan)
    if range_sigma:
        ranges = np.linalg.norm(r, axis=1) + range_sigma * rng.standard_normal(n)
    problem = replace(
        Problem.of_tracks(t, cameras, uv, 0.3),
        range_m=ranges,
        sigma_range=range_sigma or np.nan,
        attitude=seen_q,
        sigma_attitude=sigma_q,
    )
    return Scene(problem, q, w, r, *ratios(inertia))
