"""A tumbling body before one or two cameras, as a Problem with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.quaternion import rotate
from massprops.dynamics.rigid_body import propagate
from massprops.model.problem import Problem
from massprops.sensing.pinhole import Pinhole, project

INERTIA = np.array([[1.0, 0.05, -0.04], [0.05, 0.8, 0.03], [-0.04, 0.03, 0.6]])
RATE = np.radians([1.5, 2.3, -1.9])


@dataclass(frozen=True)
class Scene:
    """problem: what is measured; q (n, 4), w (n, 3), position (n, 3), features (m, 3), inertia of trace 1: the truth."""

    problem: Problem
    q: np.ndarray
    w: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    features: np.ndarray
    inertia: np.ndarray


def scene(
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
    """`seen_for`: epochs that each feature stays in sight; `missing`, `outliers`: shares of the pixels."""
    rng = np.random.default_rng(seed)
    times = np.arange(epochs) * step
    q, w = propagate(np.array([1.0, 0, 0, 0]), rate, inertia, times, largest_turn=0.02, compiled=True)
    points = rng.uniform(-1.5, 1.5, (features, 3))
    path = np.array(position) + times[:, None] * np.array(velocity)
    lens = np.array([focal, focal, 0.0, 0.0])
    places = [np.zeros(3), np.array([1.0, 0, 0])][:cameras]
    pinholes = tuple(Pinhole(lens, np.eye(3), t) for t in places)
    world = path[:, None] + rotate(q[:, None], points[None])
    uv = np.stack([project(camera, world) for camera in pinholes], axis=1)
    uv += rng.normal(0.0, sigma_px, uv.shape)
    if seen_for is not None:
        shown = np.zeros((epochs, features), bool)
        for j, start in enumerate(np.linspace(-seen_for / 2, epochs - seen_for / 2, features).astype(int)):
            shown[max(start, 0) : start + seen_for, j] = True
        uv[~np.broadcast_to(shown[:, None], uv.shape[:3])] = np.nan
    uv[rng.random(uv.shape[:3]) < missing] = np.nan
    wild = rng.random(uv.shape[:3]) < outliers
    uv[wild] += rng.normal(0.0, 250.0 * sigma_px, (int(wild.sum()), 2))
    problem = Problem.of_tracks(times, pinholes, uv, sigma_px)
    return Scene(problem, q, w, path, np.array(velocity), points, inertia / np.trace(inertia))
