"""A tumbling body before one or two cameras, with its truth: near and small, or far before long lenses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics import quaternion
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import rotate
from massprops.dynamics.rigid_body import propagate
from massprops.model.problem import Problem
from massprops.sensing.pinhole import Pinhole, project

INERTIA = np.array([[1.0, 0.05, -0.04], [0.05, 0.8, 0.03], [-0.04, 0.03, 0.6]])
RATE = np.radians([1.5, 2.3, -1.9])
"""Of the far body."""


@dataclass(frozen=True)
class Scene:
    """What is measured, and the truth: q (n, 4), w (n, 3), place and velocity in cam0 (n, 3), features (m, 3), inertia of trace 1,
    its ratios k (2,) and axes (3, 3)."""

    problem: Problem
    q: np.ndarray
    w: np.ndarray
    r: np.ndarray
    velocity: np.ndarray
    features: np.ndarray
    inertia: np.ndarray

    @property
    def k(self) -> np.ndarray:
        return ratios(self.inertia)[0]

    @property
    def axes(self) -> np.ndarray:
        return ratios(self.inertia)[1]


def images(cameras: tuple[Pinhole, ...], q: np.ndarray, place: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels (n, c, m, 2) of body points (m, 3) of a body with attitudes (n, 4) at places (n, 3)."""
    world = place[:, None] + rotate(q[:, None], points[None])
    return np.stack([project(camera, world) for camera in cameras], axis=1)


def pinholes(lens: tuple[float, float, float, float], bases: tuple[float, ...]) -> tuple[Pinhole, ...]:
    """Cameras side by side that look the same way."""
    return tuple(Pinhole(np.array(lens), np.eye(3), np.array([b, 0.0, 0.0])) for b in bases)


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
    """A body 2.4 m across, 12 m away, of which each point is seen while it looks at the camera; `gap`: epochs without images."""
    rng = np.random.default_rng(seed)
    axes = quaternion.rotation_matrix(quaternion.normalise(rng.standard_normal(4)))
    inertia = axes @ np.diag(moments) @ axes.T
    t = np.arange(n) * dt
    q, w = propagate(quaternion.normalise(rng.standard_normal(4)), axes @ np.array(spin), inertia, t, compiled=True)
    r = np.array([0.3, -0.2, 12.0]) + t[:, None] * np.array([0.002, -0.001, 0.003])
    points = rng.uniform(-1.2, 1.2, (10, 3))
    cameras = pinholes((1000.0, 1000.0, 640.0, 480.0), (0.0, 1.0) if stereo else (0.0,))
    uv = images(cameras, q, r, points)
    uv += 0.3 * rng.standard_normal(uv.shape)
    wild = rng.random(uv.shape[:3]) < outliers
    uv[wild] += rng.uniform(-80, 80, (int(wild.sum()), 2))
    away = (
        np.einsum("nij,mj->nmi", quaternion.rotation_matrix(q), points / np.linalg.norm(points, axis=1, keepdims=True))[
            ..., 2
        ]
        > 0.5
    )
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
    velocity = np.array([0.002, -0.001, 0.003])
    return Scene(problem, q, w, r, velocity, points, inertia / np.trace(inertia))


def far_scene(
    epochs: int = 300,
    features: int = 6,
    seed: int = 0,
    inertia: np.ndarray = INERTIA,
    rate: np.ndarray = RATE,
    step: float = 1.0,
    cameras: int = 2,
    focal: float = 39216.0,
    position: tuple[float, float, float] = (20.0, -30.0, 60.0),
    velocity: tuple[float, float, float] = (-0.01, 0.02, -0.01),
    sigma_px: float = 0.2,
    seen_for: int | None = None,
    missing: float = 0.0,
    outliers: float = 0.0,
) -> Scene:
    """A body 3 m across, 70 m away. `seen_for`: epochs that each feature stays in sight; `missing`, `outliers`: shares of the pixels."""
    rng = np.random.default_rng(seed)
    times = np.arange(epochs) * step
    q, w = propagate(np.array([1.0, 0, 0, 0]), rate, inertia, times, largest_turn=0.02, compiled=True)
    points = rng.uniform(-1.5, 1.5, (features, 3))
    path = np.array(position) + times[:, None] * np.array(velocity)
    rig = pinholes((focal, focal, 0.0, 0.0), (0.0, 1.0)[:cameras])
    uv = images(rig, q, path, points)
    uv += rng.normal(0.0, sigma_px, uv.shape)
    if seen_for is not None:
        shown = np.zeros((epochs, features), bool)
        for j, start in enumerate(np.linspace(-seen_for / 2, epochs - seen_for / 2, features).astype(int)):
            shown[max(start, 0) : start + seen_for, j] = True
        uv[~np.broadcast_to(shown[:, None], uv.shape[:3])] = np.nan
    uv[rng.random(uv.shape[:3]) < missing] = np.nan
    wild = rng.random(uv.shape[:3]) < outliers
    uv[wild] += rng.normal(0.0, 250.0 * sigma_px, (int(wild.sum()), 2))
    problem = Problem.of_tracks(times, rig, uv, sigma_px)
    return Scene(problem, q, w, path, np.array(velocity), points, inertia / np.trace(inertia))
